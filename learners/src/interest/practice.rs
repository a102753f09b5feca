//! Rollouts of the infant agent, and what is kept of them.

use elo_core::context::Context;
use elo_core::rollout::price;
use elo_core::seed::Stream;
use elo_core::simulator::{End, Simulator, SimulatorError};
use rand::RngExt as _;

use super::advantages::{Advantages, Step};
use super::drawing;
use super::learner::Learner;
use crate::acting::check_finite;
use crate::kernels::running_moments::{Normalizer, RunningMoments};
use crate::nn::{DiagonalGaussian, Scratch};

/// The steps of one iteration, rollout after rollout; row `i` of each belongs to step `i`.
#[derive(Clone, Debug, Default)]
pub(super) struct Experience {
    /// Normalised, one row a step.
    pub observations: Vec<f32>,
    /// Normalised observation and task features, one row a step.
    pub critic_inputs: Vec<f32>,
    /// As sampled, one row a step.
    pub actions: Vec<f32>,
    /// `o_t`.
    pub options: Vec<usize>,
    /// Rewards and values.
    pub steps: Vec<Step>,
    /// `log π_o(a|s)` when it was taken.
    pub log_probs: Vec<f32>,
    /// `log π_I(o|s)` when it was drawn; 0 where the option before went on.
    pub draw_log_probs: Vec<f32>,
    /// Of each step's decisions.
    pub advantages: Vec<Advantages>,
    /// Discounts `γ^t` since the rollout began.
    pub discounts: Vec<f64>,
    /// Where each rollout ended.
    pub ends: Vec<LastState>,
}

/// The state that the last step of a rollout led to.
#[derive(Clone, Debug)]
pub(super) enum LastState {
    /// The task ended the episode there.
    Terminal,
    /// The rollout was cut short there.
    Cut {
        /// Normalised.
        observation: Vec<f32>,
        /// The same with the task features.
        critic_input: Vec<f32>,
    },
}

/// The infant agent while it learns: acts by what [`Learner`] is now, and remembers.
pub(super) struct Infant<'a> {
    /// Whose options it has.
    pub learner: &'a Learner,
    /// How observations are scaled.
    pub normalizer: &'a Normalizer,
    /// Of all observations acted on.
    pub moments: &'a mut RunningMoments,
    /// Where steps are added.
    pub experience: &'a mut Experience,
    /// Working memory.
    pub scratch: Scratch,
}

/// One rollout's task, start and limits.
pub(super) struct Episode<'a> {
    /// `τ` and `s_0`.
    pub context: &'a Context,
    /// `τ` as the critic sees it.
    pub features: &'a [f32],
    /// Time limit.
    pub max_steps: u64,
    /// `γ`.
    pub gamma: f64,
}

impl Infant<'_> {
    /// Rolls out, and remembers every step. A simulator that fails cuts the rollout short before the step that did not
    /// take place.
    ///
    /// # Errors
    /// The simulator's, after everything up to it was remembered.
    pub fn roll_out(
        &mut self,
        simulator: &mut dyn Simulator,
        episode: &Episode<'_>,
        noise: &mut Stream,
    ) -> Result<(), SimulatorError> {
        let Context { task, start } = episode.context;
        let spec = simulator.spec();
        let (prices, mut terms) = (spec.prices(task), vec![0.0; spec.reward_terms.len()]);
        let (mut observation, mut seen) =
            (vec![0.0; spec.observation_size], vec![0.0; spec.observation_size]);
        let (mut action, mut clipped) = (vec![0.0; spec.action_size()], vec![0.0; spec.action_size()]);
        start.begin(simulator, task, &mut observation)?;
        check_finite(&observation, &[])?;

        let (mut running, mut discount) = (None, 1.0);
        for elapsed in 1..=episode.max_steps {
            self.normalizer.apply(&observation, &mut seen);
            let drawn = running.is_none();
            let (option, draw_log_prob) =
                running.map_or_else(|| self.draw(&seen, noise), |option| (option, 0.0));
            let log_prob = self.act(option, &seen, noise, &mut action);
            self.moments.update(&observation);
            clipped.copy_from_slice(&action);
            simulator.spec().clip(&mut clipped);
            let stepped = simulator.step(&clipped, &mut observation, &mut terms);
            let stepped = stepped.and_then(|end| check_finite(&observation, &terms).map(|()| end));
            let end = stepped.inspect_err(|_| self.cut(elapsed, &seen, episode.features))?;

            let reward = price(&terms, &prices);
            let last = end != End::Running || elapsed == episode.max_steps;
            let experience = &mut *self.experience;
            experience.observations.extend(&seen);
            experience.critic_inputs.extend(seen.iter().chain(episode.features));
            experience.actions.extend(&action);
            experience.options.push(option);
            experience.log_probs.push(log_prob);
            experience.draw_log_probs.push(draw_log_prob);
            experience.discounts.push(discount);
            experience.steps.push(Step { drawn, reward, last, ..Step::default() });
            if last {
                self.normalizer.apply(&observation, &mut seen);
                let terminal = end == End::Terminated;
                let state =
                    if terminal { LastState::Terminal } else { LastState::cut(&seen, episode.features) };
                self.experience.ends.push(state);
                break;
            }
            discount *= episode.gamma;
            let ends = noise.random::<f64>() < self.learner.termination.probability();
            running = (!ends).then_some(option);
        }
        Ok(())
    }

    /// Ends the rollout after the steps before this one, where `seen` is what they led to.
    fn cut(&mut self, elapsed: u64, seen: &[f32], features: &[f32]) {
        if let (2.., Some(step)) = (elapsed, self.experience.steps.last_mut()) {
            step.last = true;
            self.experience.ends.push(LastState::cut(seen, features));
        }
    }

    /// An option and the logarithm of its probability.
    fn draw(&mut self, seen: &[f32], noise: &mut Stream) -> (usize, f32) {
        let interests = &self.learner.interests;
        let mut log_interests = vec![0.0; interests.len()];
        for (z, interest) in log_interests.iter_mut().zip(interests) {
            let mut output = [0.0];
            interest.network.forward_one(seen, &mut self.scratch, &mut output);
            *z = f64::from(output[0]);
        }
        let mut probabilities = vec![0.0; interests.len()];
        drawing::probabilities(&log_interests, &mut probabilities);
        let option = drawing::pick(&probabilities, noise.random());
        // The probabilities are no longer needed.
        (option, drawing::log_probability(&log_interests, option, &mut probabilities) as f32)
    }

    /// Samples an action, and returns the logarithm of its density.
    fn act(&mut self, option: usize, seen: &[f32], noise: &mut Stream, action: &mut [f32]) -> f32 {
        let policy = &self.learner.policies[option];
        let mut means = vec![0.0; policy.log_std.len()];
        policy.means.network.forward_one(seen, &mut self.scratch, &mut means);
        let distribution = DiagonalGaussian { means: &means, log_std: &policy.log_std };
        distribution.sample(noise, action);
        distribution.log_prob(action)
    }
}

impl LastState {
    fn cut(seen: &[f32], features: &[f32]) -> Self {
        Self::Cut { observation: seen.to_vec(), critic_input: [seen, features].concat() }
    }
}
