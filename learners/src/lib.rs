//! Learners: what trains teachers and turns their trajectories into options. They see the simulators only through the
//! traits of `elo-core`.
//!
//! [`nn`] holds the small networks and their optimiser; [`kernels`] the formulas of the losses and estimates, as pure
//! functions, each with a test whose numbers are worked out by hand.
//!
//! # Adding a learner
//!
//! Write a config struct that implements [`elo_core::policy::TeacherConfig`], or [`elo_core::policy::OptionLearner`] with
//! one of its three ways ([`elo_core::policy::Imitate`], [`elo_core::policy::Apprentice`],
//! [`elo_core::policy::Practise`]), in a file of its own (a folder, if it is long), with `Default`, a sentence for each
//! field, and `validate`; add its `mod` line here and its entry to [`PLUGINS`]. Options that fit no format in the list bring their own [`elo_core::policy::PolicyFormat`], with an entry
//! too. The tests of this crate walk the list and run the conformance suites on whatever is in it.

mod acting;
pub mod behavior_cloning;
mod checkpoint;
pub mod dagger;
mod demonstration;
mod divergence;
mod fields;
pub mod interest;
pub mod kernels;
mod load;
pub mod mlp_policy;
pub mod nn;
pub mod normalized_mlp;
pub mod open_loop;
mod parallel;
pub mod ppo;

pub use load::{Options, load};

use elo_core::plugin::Plugin;

/// What this crate brings.
pub const PLUGINS: &[Plugin] = &[
    Plugin::teacher::<ppo::PpoConfig>(
        "ppo",
        "proximal policy optimisation, the paper's teachers (Eq. 2.3, 2.4)",
    ),
    Plugin::option_learner::<open_loop::OpenLoopConfig>(
        "open_loop",
        "replays the teacher's actions, the paper's options (§5.1)",
    ),
    Plugin::option_learner::<behavior_cloning::BehaviorCloningConfig>(
        "behavior_cloning",
        "a small network that acts as the teacher acted where it saw the same",
    ),
    Plugin::option_learner::<dagger::DaggerConfig>(
        "dagger",
        "clones that are tried and corrected by the teacher, several times (Ross et al. 2011)",
    ),
    Plugin::option_learner::<interest::InterestConfig>(
        "interest",
        "learns a whole set by practice: closed-loop options with interests and a learned duration (§6.2)",
    ),
    Plugin::policy_format(open_loop::FORMAT),
    Plugin::policy_format(mlp_policy::FORMAT),
    Plugin::policy_format(interest::FORMAT),
];
