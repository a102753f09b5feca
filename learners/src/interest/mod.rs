//! Closed-loop early-life options with interests and a learned duration (Weber et al. 2019, §6.2).
//!
//! `K` options share one probability of ending. Option `o` has a policy `π_o(a|s)` and an interest `I_o(s) > 0`, and
//! none of them sees the task. The infant agent draws an option where it begins and wherever one has ended:
//!
//! ```text
//! π_I(o|s)     = I_o(s) / Σ_o' I_o'(s)                                        (6.3)  drawing
//! Q(s,o|τ)     = Σ_a π_o(a|s) (r + γ Σ_s' p(s'|s,a) U(s',o|τ))           (6.4, 6.5)  advantages
//! U(s',o|τ)    = (1 − ε) Q(s',o|τ) + ε V(s'|τ),   V(s|τ) = Σ_o π_I(o|s) Q(s,o|τ)
//! ρ(ε)         = (1 − ε) / ε                                                         duration
//! φ(ε)         = squared distance of ρ(ε) from the band [ρ_min, ρ_max]        (6.6)  duration
//! J(θ)         = E_{τ~P, s~d0} V(s|τ) − λ φ(ε)                                (6.1)
//! ```
//!
//! With `ρ_min = ρ_max = ρ` the band is the paper's `φ`. The end is decided after each action, so an option takes `1/ε`
//! actions on average and continues `(1 − ε)/ε` times: `ρ` counts continuations, as Eq. 6.6 does.
//!
//! # The gradient
//!
//! Seen as one process, the agent makes three kinds of decisions, and `∇J` has a part for each. `E` is over steps `t` of
//! its rollouts, step `t` weighted by `γ^t`; `x` is the logit of `ε`:
//!
//! ```text
//! policies      E[ ∇ log π_o(a|s) · A_action ]           A_action = r + γ U(s',o) − Q(s,o)
//! interests     E[ ∇ log π_I(o|s) · A_draw ]  where drawn    A_draw = Q(s,o) − V(s)
//! termination   E[ γ ε(1 − ε) · A_end ] − λ dφ/dx          A_end  = V(s') − Q(s',o)
//! ```
//!
//! [`advantages`] estimates the three from rollouts with any critic; the log-probabilities of actions and of draws then
//! go through [`crate::kernels::clipped_surrogate`], the ends through [`duration::clipped_end`].
//!
//! # Training
//!
//! [`train`] rolls out the infant agent in tasks from `P` and from starts from `d0`, in whole rollouts, and improves
//! all parts by the clipped gradients, as PPO does. Returns are in units of their own deviation; the advantages of actions
//! and of draws are scaled to deviation 1, which changes the size of a part's gradient and not its direction, while that
//! of `ε` keeps its size: it stands against `λ φ`. Unless `discounted_visits` asks for the letter of `J`, all steps of a
//! rollout count alike, as is usual: leaving `γ^t` out learns as much from late steps as from early ones, and follows the gradient
//! of no objective to the letter (Nota & Thomas 2020). `dV/dε` is then a mean over the states that the agent meets.
//!
//! # What `J` does not ask for
//!
//! Specialisation. Where policies are given, interests separate the states in which each is of use. Where policies are
//! learned too, one option that reacts to the state can be good everywhere: in a world of two states that want opposite
//! actions, trainings come close to the greatest return, some of them with one option preferred in both. And an interest means
//! something only beside those of the same training, so options of different trainings do not make a set. On the robots in MuJoCo, sets
//! of five come to use one to three of their options (`docs/results/closed-loop.md`).
//!
//! `diversity_weight` adds the entropy of how often each option is drawn *on the whole* ([`drawing::diversity`]), which one
//! option for each state satisfies as well as any: in that world, with 0.5, each of two options makes more than a fifth of the
//! draws in every one of three trainings, at the same return; without, one of them makes less than a tenth in some.
//!
//! # Variants
//!
//! [`Risk`] replaces the mean return by `ψ_-`. With `imitation_start` the policies begin as clones of recordings of teachers;
//! everything else begins as from scratch.

pub mod advantages;
mod batch;
mod checkpoint;
mod config;
pub mod drawing;
pub mod duration;
#[cfg(test)]
mod gradient_test;
mod imitation;
mod learner;
mod policy;
mod practice;
#[cfg(test)]
mod reductions_test;
mod risk;
#[cfg(test)]
mod tests;
mod train;
mod valuation;
#[cfg(test)]
mod worlds;

pub use config::{Discounts, InterestConfig, LearningRates};
pub use policy::{FORMAT, InterestPolicy};
pub use risk::Risk;
pub use train::{Learned, Point, train};
