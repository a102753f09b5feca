//! Option sets for programs that act by them and know no simulator of ours: a robot's own software, another project's
//! environment. The counterpart of `elo.load` in Python.
//!
//! ```no_run
//! use elo_core::seed::Seed;
//!
//! let options = elo_learners::load("runs/half-cheetah-quick/results/option_sets/maximum_mean".as_ref())?;
//! let (observation, mut noise) = (vec![0.0; options.observation_size()], Seed::root(1).stream());
//! let mut action = vec![0.0; options.action_size()];
//! for elapsed in 0..options.steps() {
//!     options.policies[0].act(&observation, elapsed, &mut noise, &mut action);
//! }
//! # Ok::<(), elo_core::option_set::OptionSetError>(())
//! ```

use std::path::Path;

use elo_core::option_set::{Manifest, OptionSet, OptionSetError};
use elo_core::policy::{OptionPolicy, PolicyFormat, PolicyRecord};
use elo_core::seed::Stream;
use elo_core::spec::SimulatorSpec;

use crate::PLUGINS;

/// The options of one set.
#[derive(Debug)]
pub struct Options {
    /// Where they come from: robot, bounds, normalisation, scores, the whole config of their run.
    pub manifest: Manifest,
    /// What they do, in the order of the manifest. Their actions are clipped to the robot's bounds, as a simulator clips them.
    pub policies: Vec<Box<dyn OptionPolicy>>,
}

impl Options {
    /// Numbers in an observation.
    pub fn observation_size(&self) -> usize {
        self.manifest.spec.observation_size
    }

    /// Numbers in an action.
    pub fn action_size(&self) -> usize {
        self.manifest.spec.action_size()
    }

    /// `T`: control steps for which the options were selected.
    pub fn steps(&self) -> usize {
        self.manifest.horizon.steps
    }
}

/// Reads the set in `folder`, whose options are of this crate's formats.
///
/// # Errors
/// A folder that holds no option set, a damaged one, or a format that this crate does not know.
pub fn load(folder: &Path) -> Result<Options, OptionSetError> {
    let set = OptionSet::read(folder)?;
    let formats: Vec<PolicyFormat> = PLUGINS.iter().filter_map(|plugin| plugin.format).collect();
    let spec = &set.manifest.spec;
    let clipped = |policy| Box::new(Clipped { policy, spec: spec.clone() }) as Box<dyn OptionPolicy>;
    let policies = set.policies(spec, &formats)?.into_iter().map(clipped).collect();
    Ok(Options { manifest: set.manifest, policies })
}

/// A policy whose actions lie within the robot's bounds.
#[derive(Debug)]
struct Clipped {
    policy: Box<dyn OptionPolicy>,
    spec: SimulatorSpec,
}

impl OptionPolicy for Clipped {
    fn interest(&self, observation: &[f32]) -> f32 {
        self.policy.interest(observation)
    }

    fn act(&self, observation: &[f32], elapsed: usize, noise: &mut Stream, action: &mut [f32]) {
        self.policy.act(observation, elapsed, noise, action);
        self.spec.clip(action);
    }

    fn termination(&self, observation: &[f32], elapsed: usize) -> f64 {
        self.policy.termination(observation, elapsed)
    }

    fn record(&self) -> PolicyRecord {
        self.policy.record()
    }
}
