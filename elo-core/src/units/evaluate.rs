//! Algorithm 1(b): execute somebody in many contexts and record what became of the reward terms.

use serde::{Deserialize, Serialize};

use super::codec::{self, Malformed};
use super::loss::Piecewise;
use super::play::Play;
use super::{Site, Work, WorkError, input, learn, prepare, record};
use crate::agent::{Agent, InfantAgent, RandomTorque, Taught, ZeroTorque};
use crate::context::Context;
use crate::experiment::TeacherActs;
use crate::hosted::Hosted;
use crate::policy::{Monitor, OptionPolicy, TeacherConfig, TeacherPolicy};
use crate::rollout::{Ending, Rollout};
use crate::seed::Seed;
use crate::spec::SimulatorSpec;
use crate::workforce::TRIES;

/// Some subjects in all contexts of a split. The inputs are `contexts` results of [`prepare`], then whatever the
/// subjects name.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evaluate {
    /// How many inputs hold contexts.
    pub contexts: usize,
    /// Who, where, and for how long.
    #[serde(flatten)]
    pub play: Play,
}

/// One subject and the name of its random streams.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Subject {
    /// Unique in the run; part of the path of its streams.
    pub name: String,
    /// What it does.
    pub behavior: Behavior,
}

/// What a subject does.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Behavior {
    /// Uniformly random actions.
    RandomTorque,
    /// No action.
    ZeroTorque,
    /// An untrained teacher.
    Untrained {
        /// What makes it.
        teacher: Box<dyn TeacherConfig>,
        /// The root of its streams.
        seed: Seed,
        /// By its mean, or by samples as a learning agent would.
        acts: TeacherActs,
    },
    /// A teacher, or a policy that was kept on its way.
    Teacher {
        /// What reads it.
        teacher: Box<dyn TeacherConfig>,
        /// Which input holds it.
        input: usize,
        /// Which of the kept policies; `None` for the trained one.
        snapshot: Option<usize>,
        /// By its mean or by samples.
        acts: TeacherActs,
    },
    /// The infant agent with these options; with one option, that option again and again.
    Infant {
        /// Its options.
        options: Vec<Place>,
        /// Probability that a decision is one random primitive action.
        primitive_probability: f64,
    },
}

/// Where an option lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Which input, a result of [`learn`].
    pub input: usize,
    /// Which of its options.
    pub item: usize,
}

/// Rollouts of subjects (rows) in contexts (columns).
#[derive(Clone, Debug, PartialEq)]
pub struct RolloutTable {
    /// Reward terms of one rollout.
    pub terms: usize,
    /// Columns.
    pub contexts: usize,
    /// All rollouts, row by row.
    pub rollouts: Vec<Rollout>,
}

impl RolloutTable {
    /// One subject's rollouts.
    pub fn row(&self, subject: usize) -> &[Rollout] {
        &self.rollouts[subject * self.contexts..(subject + 1) * self.contexts]
    }
}

/// Something that can be asked for the agent that it is.
pub(super) enum Cast {
    Random,
    Zero,
    Policy { policy: Box<dyn TeacherPolicy>, sampling: bool },
    Options { options: Vec<Box<dyn OptionPolicy>>, primitive_probability: f64 },
}

impl Evaluate {
    pub(super) fn perform(
        &self,
        inputs: &[Vec<u8>],
        site: &mut Site,
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        let (mut table, keeping) = self.take_up(inputs, monitor)?;
        let contexts = self.read_contexts(inputs)?;
        let mut ensemble = self.play.ensemble(&contexts, inputs, site)?;
        let total = ensemble.rollouts();
        while table.rollouts.len() < total {
            monitor.progress(table.rollouts.len() as u64, total as u64)?;
            let (rollout, ()) = ensemble.play(table.rollouts.len())?;
            table.rollouts.push(rollout);
            if keeping {
                Self::keep(&table, monitor)?;
            }
        }
        Ok(table.encode())
    }
}

impl Evaluate {
    pub(super) fn read_contexts(&self, inputs: &[Vec<u8>]) -> Result<Vec<Context>, WorkError> {
        let mut contexts = Vec::new();
        for index in 0..self.contexts {
            contexts.extend(prepare::decode(input(inputs, index)?)?);
        }
        Ok(contexts)
    }
}

/// Rollout by rollout, row by row.
impl Piecewise for Evaluate {
    type Done = RolloutTable;

    fn begin(&self, inputs: &[Vec<u8>]) -> Result<RolloutTable, WorkError> {
        let contexts = self.read_contexts(inputs)?.len();
        let terms = self.play.simulator.spec()?.reward_terms.len();
        Ok(RolloutTable { terms, contexts, rollouts: Vec::new() })
    }

    fn to_bytes(done: &RolloutTable) -> Vec<u8> {
        done.encode()
    }

    fn from_bytes(bytes: &[u8]) -> Result<RolloutTable, Malformed> {
        RolloutTable::decode(bytes)
    }

    fn result(&self, done: &RolloutTable) -> Option<Vec<u8>> {
        (done.rollouts.len() == done.contexts * self.play.subjects.len()).then(|| done.encode())
    }

    /// Where a subject has failed [`TRIES`] times in a row, its other contexts here are not tried: each would cost as many workers.
    fn give_up_next(&self, done: &mut RolloutTable, reason: &str) -> Result<(), WorkError> {
        let terms = done.terms;
        let failed = |why: &str| Rollout {
            term_sums: vec![0.0; terms],
            length: 0,
            ending: Ending::failed(why),
            clamped: 0,
        };
        done.rollouts.push(failed(reason));
        let end = done.rollouts.len().next_multiple_of(done.contexts);
        let row = &done.rollouts[end - done.contexts..];
        let hopeless =
            |last: &[Rollout]| last.iter().all(|rollout| matches!(rollout.ending, Ending::Failed(_)));
        if row.len() >= TRIES && hopeless(&row[row.len() - TRIES..]) {
            done.rollouts.resize(
                end,
                failed(&format!("{reason} (so ended the last of {TRIES} in a row; this one was not tried)")),
            );
        }
        Ok(())
    }
}

impl Subject {
    /// Its plugin, if its code runs outside this process.
    pub(super) fn hosted(&self) -> Option<&dyn Hosted> {
        match &self.behavior {
            Behavior::Untrained { teacher, .. } | Behavior::Teacher { teacher, .. } => teacher.hosted(),
            Behavior::RandomTorque | Behavior::ZeroTorque | Behavior::Infant { .. } => None,
        }
    }

    pub(super) fn cast(
        &self,
        inputs: &[Vec<u8>],
        site: &mut Site,
        spec: &SimulatorSpec,
    ) -> Result<Cast, WorkError> {
        let failed = |error: crate::tensors::TensorError| WorkError::Failed(error.to_string());
        Ok(match &self.behavior {
            Behavior::RandomTorque => Cast::Random,
            Behavior::ZeroTorque => Cast::Zero,
            Behavior::Untrained { teacher, seed, acts } => {
                let untrained = teacher.untrained(spec, seed);
                let none = || WorkError::Failed("this teacher was never untrained".to_owned());
                let policy = teacher.load(&untrained.ok_or_else(none)?, spec).map_err(failed)?;
                Cast::Policy { policy, sampling: *acts == TeacherActs::Sample }
            }
            Behavior::Teacher { teacher, input: index, snapshot, acts } => {
                let policy = record::load(teacher.as_ref(), input(inputs, *index)?, *snapshot, spec)?;
                Cast::Policy { policy, sampling: *acts == TeacherActs::Sample }
            }
            Behavior::Infant { options, primitive_probability } => {
                let load = |place: &Place| -> Result<Box<dyn OptionPolicy>, WorkError> {
                    let records = learn::decode(input(inputs, place.input)?)?;
                    let record = records.into_iter().nth(place.item).flatten();
                    let record = record.ok_or_else(|| WorkError::Failed("no such option".to_owned()))?;
                    record.policy(spec, &site.formats).map_err(|error| WorkError::Failed(error.to_string()))
                };
                let options = options.iter().map(load).collect::<Result<_, _>>()?;
                Cast::Options { options, primitive_probability: *primitive_probability }
            }
        })
    }
}

impl Cast {
    pub(super) fn play(
        &self,
        spec: &SimulatorSpec,
        mut act: impl FnMut(&mut dyn Agent) -> Rollout,
    ) -> Rollout {
        match self {
            Self::Random => act(&mut RandomTorque::new(spec)),
            Self::Zero => act(&mut ZeroTorque),
            Self::Policy { policy, sampling } => {
                act(&mut Taught { policy: policy.as_ref(), sampling: *sampling })
            }
            Self::Options { options, primitive_probability } => {
                let options: Vec<&dyn OptionPolicy> = options.iter().map(AsRef::as_ref).collect();
                act(&mut InfantAgent::mixed(&options, *primitive_probability, spec))
            }
        }
    }
}

/// Codes of [`Ending`] in files: 0 horizon, 1 terminated, 2 truncated, 3 failed.
pub fn ending_code(ending: &Ending) -> u8 {
    match ending {
        Ending::Horizon => 0,
        Ending::Terminated => 1,
        Ending::Truncated => 2,
        Ending::Failed(_) => 3,
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    terms: usize,
    contexts: usize,
    rollouts: usize,
    /// Position and reason of each failed rollout.
    failures: Vec<(usize, String)>,
}

impl RolloutTable {
    /// The bytes of the table.
    pub fn encode(&self) -> Vec<u8> {
        let failure = |(i, r): (usize, &Rollout)| match &r.ending {
            Ending::Failed(why) => Some((i, why.clone())),
            Ending::Horizon | Ending::Terminated | Ending::Truncated => None,
        };
        let head = Head {
            terms: self.terms,
            contexts: self.contexts,
            rollouts: self.rollouts.len(),
            failures: self.rollouts.iter().enumerate().filter_map(failure).collect(),
        };
        let sums: Vec<f64> = self.rollouts.iter().flat_map(|r| r.term_sums.iter().copied()).collect();
        let lengths: Vec<u32> = self.rollouts.iter().map(|r| r.length).collect();
        let clamped: Vec<u32> = self.rollouts.iter().map(|r| r.clamped).collect();
        let endings: Vec<u8> = self.rollouts.iter().map(|r| ending_code(&r.ending)).collect();
        let sections =
            [&codec::f64_bytes(&sums), &codec::u32_bytes(&lengths), &codec::u32_bytes(&clamped), &endings];
        codec::encode(&head, &sections.map(Vec::as_slice))
    }

    /// Reads a unit's result.
    ///
    /// # Errors
    /// [`Malformed`].
    pub fn decode(bytes: &[u8]) -> Result<Self, Malformed> {
        let (head, sections): (Head, _) = codec::decode(bytes)?;
        let [sums, lengths, clamped, endings] = sections[..] else {
            return Err(Malformed(format!("{} sections", sections.len())));
        };
        let sums = codec::f64_numbers(sums, head.rollouts * head.terms)?;
        let lengths = codec::u32_numbers(lengths, head.rollouts)?;
        let clamped = codec::u32_numbers(clamped, head.rollouts)?;
        if endings.len() != head.rollouts || head.terms == 0 {
            return Err(Malformed(format!("{} endings of {} rollouts", endings.len(), head.rollouts)));
        }
        let mut reasons: std::collections::BTreeMap<usize, String> = head.failures.into_iter().collect();
        let rollouts = (0..head.rollouts)
            .map(|i| {
                let ending = match endings[i] {
                    0 => Ending::Horizon,
                    1 => Ending::Terminated,
                    2 => Ending::Truncated,
                    _ => Ending::Failed(reasons.remove(&i).unwrap_or_default()),
                };
                let term_sums = sums[i * head.terms..(i + 1) * head.terms].to_vec();
                Rollout { term_sums, length: lengths[i], ending, clamped: clamped[i] }
            })
            .collect();
        Ok(Self { terms: head.terms, contexts: head.contexts, rollouts })
    }
}

impl From<Evaluate> for Work {
    fn from(work: Evaluate) -> Self {
        Self::Evaluate(work)
    }
}
