//! Teachers and options, and the inert configs that train and learn them.
//!
//! Policies are pure functions of observation, elapsed steps and a random stream: they hold no state that changes, so
//! one object serves all threads.
//!
//! Observations are as the simulator gives them, not normalised: `observation_size` finite numbers in the units of the simulator. Actions have one
//! number for each component of the spec's bounds and must be finite; they may lie outside the bounds, where the simulator clamps them
//! and a rollout counts the step as clamped. `load` and [`PolicyLoader`] refuse a robot of other sizes, so a slice of another length
//! is a mistake of the caller: a policy may panic or not notice it.

use std::fmt;
use std::path::Path;

use crate::context::InitialStates;
use crate::fault::Faults;
use crate::hosted::Hosted;
use crate::rollout::Horizon;
use crate::seed::{Seed, Stream};
use crate::simulator::{BuildError, SimulatorConfig};
use crate::spec::SimulatorSpec;
use crate::task::{Task, TaskDistribution};
use crate::tensors::{TensorError, Tensors};

/// `π*_τ`: a policy that is near-optimal in one task.
pub trait TeacherPolicy: Send + Sync {
    /// Writes the action for `observation`, every component of it, whatever `action` held. Without `noise` it is the policy's mean action,
    /// with it a sample, which depends on nothing else. Code that fails writes NaN, which ends the rollout, and says why in [`Self::trouble`].
    fn act(&self, observation: &[f32], noise: Option<&mut Stream>, action: &mut [f32]);

    /// Why the last action was not finite, for policies whose code can fail. It is told and forgotten.
    fn trouble(&self) -> Option<String> {
        None
    }
}

/// `(I_o, π_o, β_o)`: one early-life option.
pub trait OptionPolicy: Send + Sync + fmt::Debug {
    /// `I_o(s)`, finite and above 0: how much the agent prefers to start this option here. Only its ratio to the other options' counts.
    /// 1 for options without an initiation set.
    fn interest(&self, _observation: &[f32]) -> f32 {
        1.0
    }

    /// `π_o`: writes every component of the action, `elapsed` control steps after the option began (0 for its first one). `noise` is the
    /// only randomness. Actions are finite also after the option should have ended.
    fn act(&self, observation: &[f32], elapsed: usize, noise: &mut Stream, action: &mut [f32]);

    /// `β_o`: the probability in [0, 1] that the option ends here, after `elapsed >= 1` of its actions.
    fn termination(&self, observation: &[f32], elapsed: usize) -> f64;

    /// The option as tensors of one declared format, see [`PolicyFormat`].
    fn record(&self) -> PolicyRecord;
}

/// An option policy at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct PolicyRecord {
    /// The [`PolicyFormat::name`] that reads it.
    pub format: String,
    /// Its numbers.
    pub tensors: Tensors,
}

impl PolicyRecord {
    /// The running policy for a robot of this spec, read by one of `formats`.
    ///
    /// # Errors
    /// None of `formats` has the record's name; tensors of another shape.
    pub fn policy(
        &self,
        spec: &SimulatorSpec,
        formats: &[PolicyFormat],
    ) -> Result<Box<dyn OptionPolicy>, UnreadablePolicy> {
        let format = formats.iter().find(|format| format.name == self.format).ok_or_else(|| {
            let known = formats.iter().map(|format| format.name).collect::<Vec<_>>().join(", ");
            UnreadablePolicy::Format { format: self.format.clone(), known }
        })?;
        Ok((format.load)(&self.tensors, spec)?)
    }
}

/// Why a record is no policy here.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum UnreadablePolicy {
    /// No plugin knows its format.
    #[error("no plugin reads policies of format `{format}` ({known})")]
    Format {
        /// The record's.
        format: String,
        /// Those that plugins read.
        known: String,
    },
    /// Tensors of another shape.
    #[error(transparent)]
    Tensors(#[from] TensorError),
}

/// How option policies of one kind are stored. Any number of learners may write one format.
#[derive(Clone, Copy)]
pub struct PolicyFormat {
    /// Its name in option-set files.
    pub name: &'static str,
    /// What the tensors are, with their shapes.
    pub summary: &'static str,
    /// Makes the policy for a robot of this spec.
    pub load: PolicyLoader,
}

/// Makes an option policy of stored tensors, for a robot of the given spec; refuses tensors of another shape.
pub type PolicyLoader = fn(&Tensors, &SimulatorSpec) -> Result<Box<dyn OptionPolicy>, TensorError>;

/// How teachers are trained: `[teacher]` of a config, by its `kind`.
#[typetag::serde(tag = "kind")]
pub trait TeacherConfig: fmt::Debug + Send + Sync {
    /// Makes what refers to files (relative to `folder`) mean the same everywhere. Called once, before `validate`.
    fn embed_files(&mut self, _folder: &Path, _faults: &mut Faults) {}

    /// Finds every fault of the fields.
    fn validate(&self, faults: &mut Faults);

    /// Where its code runs, if not in the caller's process.
    fn hosted(&self) -> Option<&dyn Hosted> {
        None
    }

    /// [`Self::hosted`], to be told what its worker says.
    fn hosted_mut(&mut self) -> Option<&mut dyn Hosted> {
        None
    }

    /// Simulator steps that one training takes, for estimates.
    fn simulator_steps(&self) -> u64;

    /// Starts that one training draws from `d0` beside these steps, for estimates.
    fn starts(&self) -> u64 {
        0
    }

    /// Trains one teacher. The bytes depend on nothing but the lesson, also when it was interrupted at a checkpoint and
    /// taken up again.
    ///
    /// # Errors
    /// See [`TrainError`].
    fn train(&self, lesson: &Lesson<'_>, monitor: &mut dyn Monitor) -> Result<Trained, TrainError>;

    /// The policy before any training, as [`Self::load`] reads it; `None` for teachers that were never without.
    fn untrained(&self, spec: &SimulatorSpec, seed: &Seed) -> Option<Tensors>;

    /// Makes a policy of stored tensors.
    ///
    /// # Errors
    /// Tensors of another shape.
    fn load(&self, tensors: &Tensors, spec: &SimulatorSpec) -> Result<Box<dyn TeacherPolicy>, TensorError>;
}

/// What one teacher is to learn.
#[derive(Clone, Debug)]
pub struct Lesson<'a> {
    /// Where it practises.
    pub simulator: &'a dyn SimulatorConfig,
    /// The task that it is to master.
    pub task: &'a Task,
    /// `d0`, from which a share of its episodes begins.
    pub initial_states: &'a InitialStates,
    /// The root of its random streams.
    pub seed: Seed,
}

/// A trained teacher.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained {
    /// The policy, as [`TeacherConfig::load`] reads it.
    pub policy: Tensors,
    /// The policy at intervals during training, for learning curves; the last is `policy`.
    pub snapshots: Vec<Snapshot>,
    /// What was seen during training, by its increasing `steps`.
    pub curve: Vec<CurvePoint>,
}

/// The policy after `steps` simulator steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// Simulator steps taken so far.
    pub steps: u64,
    /// The policy, as [`TeacherConfig::load`] reads it.
    pub policy: Tensors,
}

/// One point of a learning curve.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvePoint {
    /// Simulator steps taken so far.
    pub steps: u64,
    /// Mean undiscounted return of the training episodes that ended since the last point; `None` if none did.
    pub mean_return: Option<f64>,
    /// Mean length of those episodes in control steps.
    pub mean_length: Option<f64>,
}

/// How a long computation talks to whoever runs it, from any one of its threads at a time.
pub trait Monitor: Send {
    /// The newest checkpoint of this computation, if it was interrupted.
    fn resume(&mut self) -> Option<Vec<u8>>;

    /// Stores a checkpoint.
    ///
    /// # Errors
    /// [`Stopped`] when it could not be stored or the computation is to stop; it can be taken up from here.
    fn checkpoint(&mut self, bytes: &[u8]) -> Result<(), Stopped>;

    /// Tells how far it is: `done` of `total` simulator steps.
    ///
    /// # Errors
    /// [`Stopped`] when the computation is to stop now.
    fn progress(&mut self, done: u64, total: u64) -> Result<(), Stopped>;

    /// How many threads it may use, at least 1. What comes out must not depend on it.
    fn threads(&self) -> usize {
        1
    }
}

/// A [`Monitor`] for tests and library users: no checkpoints, no reports, never stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Monitor for Unwatched {
    fn resume(&mut self) -> Option<Vec<u8>> {
        None
    }
    fn checkpoint(&mut self, _: &[u8]) -> Result<(), Stopped> {
        Ok(())
    }
    fn progress(&mut self, _: u64, _: u64) -> Result<(), Stopped> {
        Ok(())
    }
}

/// The computation was asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped before the end")]
pub struct Stopped;

/// Why a training gave no teacher, or a practice no set.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrainError {
    /// Losses or parameters stopped being finite, the policy collapsed, or the teacher earns significantly less than random torque
    /// ([`crate::units::train`]). Worth another seed.
    #[error("diverged after {steps} steps: {reason}")]
    Diverged {
        /// Simulator steps taken until then.
        steps: u64,
        /// What was seen.
        reason: String,
    },
    /// Asked to stop; resumable from the last checkpoint.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The simulator could not be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// Anything else.
    #[error("{0}")]
    Other(String),
}

/// How options are learned: `[option_learner]` of a config, by its `kind`.
#[typetag::serde(tag = "kind")]
pub trait OptionLearner: fmt::Debug + Send + Sync {
    /// Finds every fault of the fields.
    fn validate(&self, faults: &mut Faults);

    /// From what it learns.
    fn way(&self) -> Way<'_>;
}

/// The ways of learning options.
#[derive(Clone, Copy)]
pub enum Way<'a> {
    /// One option of each recording of a teacher, as Algorithm 1 does. Sets are chosen among the options.
    Imitates(&'a dyn Imitate),
    /// The same, with the teacher at hand: the option is tried, and the teacher says what it would have done.
    Apprentices(&'a dyn Apprentice),
    /// A whole set at once, from rollouts of its own. One is chosen among the sets.
    Practises(&'a dyn Practise),
}

/// Learns an option from a recording.
pub trait Imitate: Send + Sync {
    /// Makes the option that reproduces `demonstration`.
    ///
    /// # Errors
    /// A sentence that says why it cannot be reproduced.
    fn learn(
        &self,
        demonstration: &Demonstration,
        spec: &SimulatorSpec,
        seed: &Seed,
    ) -> Result<Box<dyn OptionPolicy>, String>;
}

/// Learns an option from a recording and from the teacher's corrections.
pub trait Apprentice: Send + Sync {
    /// How often learning one option asks to be corrected at most, for estimates.
    fn corrections(&self) -> u64;

    /// Makes the option that reproduces `demonstration` and does what `tutor` would do where it itself comes to.
    ///
    /// # Errors
    /// A sentence that says why it cannot be reproduced.
    fn learn(
        &self,
        demonstration: &Demonstration,
        tutor: &mut dyn Tutor,
        seed: &Seed,
    ) -> Result<Box<dyn OptionPolicy>, String>;
}

/// A teacher, and the world in which its apprentice tries itself.
pub trait Tutor {
    /// The world's description.
    fn spec(&self) -> &SimulatorSpec;

    /// Runs `option` in the teacher's task, from a start drawn from `d0`, until it ends or falls. Returns what it saw, and what
    /// the teacher would have done there, by its mean; a simulator that fails cuts that short, to nothing in the extreme.
    ///
    /// # Errors
    /// When no start could be drawn.
    fn correct(&mut self, option: &dyn OptionPolicy, seed: &Seed) -> Result<Demonstration, String>;
}

/// Learns a set of options from rollouts.
pub trait Practise: Send + Sync {
    /// Simulator steps that learning one set takes, for estimates.
    fn simulator_steps(&self) -> u64;

    /// Starts that learning one set draws from `d0` beside these steps, for estimates.
    fn starts(&self) -> u64 {
        0
    }

    /// Whether a set begins from recordings of teachers, one an option.
    fn begins_from_recordings(&self) -> bool {
        false
    }

    /// Learns one set. The bytes depend on nothing but the practice, also when it was interrupted at a checkpoint and
    /// taken up again.
    ///
    /// # Errors
    /// See [`TrainError`].
    fn practise(&self, practice: &Practice<'_>, monitor: &mut dyn Monitor) -> Result<Practised, TrainError>;
}

/// Where and for what a set of options is learned.
#[derive(Clone, Debug)]
pub struct Practice<'a> {
    /// The world.
    pub simulator: &'a dyn SimulatorConfig,
    /// `P`: options are for all of its tasks.
    pub tasks: &'a TaskDistribution,
    /// `d0`: where rollouts begin.
    pub initial_states: &'a InitialStates,
    /// `K`: options in the set.
    pub set_size: usize,
    /// How long a rollout of the infant agent lasts, and whether a fall ends it.
    pub horizon: Horizon,
    /// For learners that begin from recordings: one at least and at most `set_size` of them, for those that fell are left out.
    pub demonstrations: &'a [Demonstration],
    /// The root of all random streams.
    pub seed: Seed,
}

/// What came of a practice.
#[derive(Debug)]
pub struct Practised {
    /// The set.
    pub options: Vec<Box<dyn OptionPolicy>>,
    /// What was seen on the way, by its increasing `steps`.
    pub curve: Vec<CurvePoint>,
}

/// `h_i`: what a teacher saw and did for `T` control steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Demonstration {
    /// `T` rows of `observation_size` numbers: what was seen before each action.
    pub observations: Vec<f32>,
    /// `T` rows of `action_size` numbers.
    pub actions: Vec<f32>,
    /// `T`.
    pub steps: usize,
}

impl fmt::Debug for PolicyFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PolicyFormat").field("name", &self.name).finish_non_exhaustive()
    }
}
