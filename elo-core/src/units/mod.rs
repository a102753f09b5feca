//! The stages of Algorithm 1 as units of work: pure functions from a description and the results of other units to
//! bytes.
//!
//! Each file has one stage: what describes a unit, how it is performed, and its result with its bytes. A description
//! holds that stage's own parameters and nothing else, because the unit's key is their hash: what is not in here cannot
//! cause work to be done again.

pub mod apprentice;
mod arena;
mod attempts;
pub mod codec;
pub mod describe;
pub mod evaluate;
pub mod film;
pub mod learn;
pub mod loss;
pub mod play;
pub mod practise;
pub mod prepare;
pub mod record;
pub mod rehearse;
pub mod score;
pub mod trace;
pub mod train;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::hosted::{Hosted, WorkerProgram};
use crate::key::{Key, Stage};
use crate::policy::{Monitor, PolicyFormat, Stopped};
use crate::seed::Seed;
use crate::simulator::{BuildError, Engine, Simulator, SimulatorConfig};
use crate::workforce::TRIES;
use codec::Malformed;
use evaluate::{Evaluate, Subject};
use film::Film;
use loss::{AfterLoss, Piecewise as _};
use trace::{Trace, Traced};

/// A unit's description; its variants are the stages.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "stage", rename_all = "snake_case")]
pub enum Work {
    /// One teacher.
    Train(train::Train),
    /// Some recordings of teachers.
    Record(record::Record),
    /// The options of those recordings.
    Learn(learn::Learn),
    /// The same, with the teachers at hand.
    Apprentice(apprentice::Apprentice),
    /// One set of options that are learned together.
    Practise(practise::Practise),
    /// Some contexts.
    Prepare(prepare::Prepare),
    /// Some rollouts.
    Evaluate(Evaluate),
    /// What is seen in some rollouts.
    Trace(Trace),
    /// What some rollouts look like.
    Film(Film),
    /// Some scores.
    Score(score::Score),
    /// What a plugin is.
    Describe(describe::Describe),
    /// Whether an environment can be used.
    Rehearse(rehearse::Rehearse),
}

impl Work {
    /// The stage's name and the version of its code. The version is part of every key: raise it with every change of a
    /// stage's results.
    pub fn stage(&self) -> Stage {
        let name = match self {
            Self::Train(_) => "train",
            Self::Record(_) => "record",
            Self::Learn(_) => "learn",
            Self::Apprentice(_) => "apprentice",
            Self::Practise(_) => "practise",
            Self::Prepare(_) => "prepare",
            Self::Evaluate(_) => "evaluate",
            Self::Trace(_) => "trace",
            Self::Film(_) => "film",
            Self::Score(_) => "score",
            Self::Describe(_) => "describe",
            Self::Rehearse(_) => "rehearse",
        };
        let version = match self {
            Self::Train(_) | Self::Practise(_) => 2,
            _ => 1,
        };
        Stage { name, version }
    }

    /// The simulator that the unit needs, if any.
    pub fn simulator(&self) -> Option<&dyn SimulatorConfig> {
        match self {
            Self::Train(work) => Some(work.simulator.as_ref()),
            Self::Record(work) => Some(work.simulator.as_ref()),
            Self::Apprentice(work) => Some(work.recording.simulator.as_ref()),
            Self::Practise(work) => Some(work.simulator.as_ref()),
            Self::Prepare(work) => Some(work.simulator.as_ref()),
            Self::Rehearse(work) => Some(work.0.as_ref()),
            Self::Evaluate(Evaluate { play, .. })
            | Self::Trace(Trace(play))
            | Self::Film(Film { rollouts: Evaluate { play, .. }, .. }) => Some(play.simulator.as_ref()),
            Self::Learn(_) | Self::Score(_) | Self::Describe(_) => None,
        }
    }

    /// Every plugin of the unit whose code runs outside this process.
    fn hosted(&self) -> Vec<&dyn Hosted> {
        let simulator = self.simulator().map(SimulatorConfig::hosted);
        let other = match self {
            Self::Train(work) => vec![work.teacher.hosted()],
            Self::Record(work) => vec![work.teacher.hosted()],
            Self::Apprentice(work) => vec![work.recording.teacher.hosted()],
            Self::Evaluate(Evaluate { play, .. })
            | Self::Trace(Trace(play))
            | Self::Film(Film { rollouts: Evaluate { play, .. }, .. }) => {
                play.subjects.iter().map(Subject::hosted).collect()
            }
            Self::Score(work) => vec![work.metric.hosted()],
            Self::Describe(work) => vec![work.hosted()],
            Self::Prepare(_) | Self::Learn(_) | Self::Practise(_) | Self::Rehearse(_) => Vec::new(),
        };
        simulator.into_iter().chain(other).flatten().collect()
    }

    /// The program that does the unit, if not the caller's own: the interpreter of one of its plugins, which can run the
    /// others too, or else the simulator's worker.
    pub fn worker(&self) -> Option<WorkerProgram> {
        let programs = || self.hosted().into_iter().map(Hosted::worker);
        programs().find(WorkerProgram::is_interpreter).or_else(|| programs().next())
    }

    /// The unit's key, see [`Key`].
    pub fn key(&self, inputs: &[Key], program: &str) -> Key {
        let engine = self.simulator().map(SimulatorConfig::engine);
        let seed = match self {
            Self::Train(work) => &work.seed,
            Self::Record(work) => &work.seed,
            Self::Learn(work) => &work.seed,
            Self::Apprentice(work) => &work.seed,
            Self::Practise(work) => &work.seed,
            Self::Prepare(work) => &work.seed,
            Self::Evaluate(Evaluate { play, .. })
            | Self::Trace(Trace(play))
            | Self::Film(Film { rollouts: Evaluate { play, .. }, .. }) => &play.seed,
            Self::Score(work) => &work.seed,
            Self::Describe(_) | Self::Rehearse(_) => &Seed::root(0),
        };
        Key::of(&self.stage(), self, inputs, seed, &fingerprint(program, engine.as_ref()))
    }

    /// Does the work.
    ///
    /// # Errors
    /// See [`WorkError`].
    pub fn perform(
        &self,
        inputs: &[Vec<u8>],
        site: &mut Site,
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        match self {
            Self::Train(work) => work.perform(monitor),
            Self::Record(work) => work.perform(inputs, site, monitor),
            Self::Learn(work) => work.perform(inputs, monitor),
            Self::Apprentice(work) => work.perform(inputs, site, monitor),
            Self::Practise(work) => work.perform(inputs, monitor),
            Self::Prepare(work) => work.perform(site, monitor),
            Self::Evaluate(work) => work.perform(inputs, site, monitor),
            Self::Trace(work) => work.perform(inputs, site, monitor),
            Self::Film(work) => work.perform(inputs, site, monitor),
            Self::Score(work) => work.perform(inputs, monitor),
            Self::Describe(work) => work.perform(),
            Self::Rehearse(work) => work.perform(monitor),
        }
    }
}

impl Work {
    /// Workers that may be lost over the unit before [`Self::after_loss`] is asked. Stages that keep what they have done
    /// count there how many each rollout costs.
    pub fn workers(&self) -> usize {
        match self {
            Self::Evaluate(_) | Self::Record(_) => 1,
            _ => TRIES,
        }
    }

    /// What becomes of a unit over which [so many](Self::workers) workers were lost, whose newest checkpoint is `kept`.
    /// A rollout that loses too many of them is recorded as failed for this `reason` and counted by the failure rule, and
    /// a recording is taken again; films and trajectories are left out. `None` for other stages, which cannot go on.
    ///
    /// # Errors
    /// Inputs or a checkpoint that cannot be read; a hosted teacher whose every take failed.
    pub fn after_loss(
        &self,
        inputs: &[Vec<u8>],
        kept: Option<&[u8]>,
        reason: &str,
    ) -> Result<Option<AfterLoss>, WorkError> {
        match self {
            Self::Evaluate(work) => work.after_loss(inputs, kept, reason).map(Some),
            Self::Record(work) => work.after_loss(inputs, kept, reason).map(Some),
            Self::Film(_) => Ok(Some(AfterLoss::Result(film::Filmed::nothing().encode()))),
            Self::Trace(_) => Ok(Some(AfterLoss::Result(Traced::Lost(reason.to_owned()).encode()))),
            Self::Train(_)
            | Self::Learn(_)
            | Self::Apprentice(_)
            | Self::Practise(_)
            | Self::Prepare(_)
            | Self::Score(_)
            | Self::Describe(_)
            | Self::Rehearse(_) => Ok(None),
        }
    }
}

/// Program and engine, in the words that enter a key.
fn fingerprint(program: &str, engine: Option<&Engine>) -> String {
    engine.map_or(program.to_owned(), |engine| format!("{program}; {} {}", engine.name, engine.version))
}

/// What a worker keeps between units: built simulators and the known formats of policies.
pub struct Site {
    simulators: BTreeMap<String, Box<dyn Simulator>>,
    formats: Vec<PolicyFormat>,
}

impl Site {
    /// An empty site that can read options of these formats.
    pub fn new(formats: Vec<PolicyFormat>) -> Self {
        Self { simulators: BTreeMap::new(), formats }
    }

    /// The simulator of `config`, built once.
    fn simulator(&mut self, config: &dyn SimulatorConfig) -> Result<&mut dyn Simulator, BuildError> {
        self.named_simulator(&name(config), config)
    }

    /// The simulator of `config`, whose [`name`] is known already.
    fn named_simulator(
        &mut self,
        name: &str,
        config: &dyn SimulatorConfig,
    ) -> Result<&mut dyn Simulator, BuildError> {
        if !self.simulators.contains_key(name) {
            self.simulators.insert(name.to_owned(), config.build()?);
        }
        Ok(self.simulators.get_mut(name).expect("it was put there").as_mut())
    }
}

fn name(config: &dyn SimulatorConfig) -> String {
    serde_json::to_string(config).expect("a config is plain data")
}

/// Why a unit has no result.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WorkError {
    /// Asked to stop.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The simulator could not be built.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// It cannot be done, now or on a second try.
    #[error("{0}")]
    Failed(String),
}

impl From<Malformed> for WorkError {
    fn from(error: Malformed) -> Self {
        Self::Failed(error.to_string())
    }
}

fn input(inputs: &[Vec<u8>], index: usize) -> Result<&[u8], WorkError> {
    inputs
        .get(index)
        .map(Vec::as_slice)
        .ok_or_else(|| WorkError::Failed(format!("input {index} of {} is missing", inputs.len())))
}

/// The numbers `first..first + count` of a stage's items, so that units are the same however the rest is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Span {
    /// The first item.
    pub first: usize,
    /// How many.
    pub count: usize,
}

impl Span {
    /// `total` items in spans of `size`; the last may be shorter.
    pub fn cut(total: usize, size: usize) -> Vec<Self> {
        (0..total).step_by(size).map(|first| Self { first, count: size.min(total - first) }).collect()
    }

    /// The items' numbers.
    pub fn items(self) -> std::ops::Range<usize> {
        self.first..self.first + self.count
    }

    /// The stream of each item, by its number in the whole stage.
    pub fn seeds(self, stage: &Seed) -> impl Iterator<Item = (usize, Seed)> {
        self.items().map(move |item| (item, stage.index(item as u64)))
    }
}
