//! Algorithm 1(a), the loop: execute a teacher for `T` steps from a random context and record its trajectory.

use serde::{Deserialize, Serialize};

use super::arena::Arena;
use super::codec::{self, Malformed};
use super::loss::Piecewise;
use super::prepare::TaskSource;
use super::train::TeacherResult;
use super::{Site, Span, Work, WorkError, input};
use crate::agent::Taught;
use crate::context::{Context, InitialStates};
use crate::experiment::TeacherActs;
use crate::policy::{Demonstration, Monitor, TeacherConfig, TeacherPolicy};
use crate::rollout::{Ending, Horizon, Rollout, Setting, Tape, price, watched};
use crate::seed::Seed;
use crate::simulator::SimulatorConfig;
use crate::spec::SimulatorSpec;
use crate::task::Task;
use crate::workforce::TRIES;

/// Recordings for some candidates. The inputs are the results of the teachers, in the order of `tasks`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// The world that teachers are recorded in.
    pub simulator: Box<dyn SimulatorConfig>,
    /// What reads the teachers.
    pub teacher: Box<dyn TeacherConfig>,
    /// `W`: the task of each teacher.
    pub tasks: Vec<Task>,
    /// `d0`.
    pub initial_states: InitialStates,
    /// Whether teachers act by their mean.
    pub acts: TeacherActs,
    /// `T`, and the discount of the recorded return.
    pub horizon: Horizon,
    /// How often a fallen recording is taken again.
    pub max_retakes: u32,
    /// Which candidates.
    pub span: Span,
    /// The root of the stage's streams; candidate `i` draws from its child `i` alone.
    pub seed: Seed,
}

/// One candidate's recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Which teacher, i.e. which task of `W`.
    pub teacher: usize,
    /// Recordings that fell or failed before the end and were taken again.
    pub retakes: u32,
    /// Takes, by their number, in which the simulator or the teacher failed or that the environment cut short: why.
    pub failures: Vec<(u32, String)>,
    /// The teacher's own return over the recorded steps, in its own task.
    pub teacher_return: f64,
    /// What was recorded; `None` when every take fell or failed.
    pub demonstration: Option<Demonstration>,
}

/// The recordings that are done, and how far the next one is.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Taken {
    recordings: Vec<Recording>,
    next: Takes,
}

/// Takes of one candidate, none of which lasted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Takes {
    /// How many.
    count: u32,
    /// How many of them failed rather than fell.
    failed: u32,
    /// Over how many of them every worker was lost. Each costs so much that a candidate has [`TRIES`] of them at most.
    lost: u32,
    /// As those of a [`Recording`].
    failures: Vec<(u32, String)>,
}

impl Record {
    pub(super) fn perform(
        &self,
        inputs: &[Vec<u8>],
        site: &mut Site,
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        let (mut taken, keeping) = self.take_up(inputs, monitor)?;
        let mut arena = Arena::new(site, self.simulator.as_ref());
        let teachers = self.teachers(inputs, arena.simulator()?.spec())?;
        while taken.recordings.len() < self.span.count {
            monitor.progress(taken.recordings.len() as u64, self.span.count as u64)?;
            self.take_next(&mut arena, &teachers, &mut taken)?;
            if keeping {
                Self::keep(&taken, monitor)?;
            }
        }
        Ok(encode(&taken.recordings))
    }

    /// The teachers, in the order of `tasks`.
    pub(super) fn teachers(
        &self,
        inputs: &[Vec<u8>],
        spec: &SimulatorSpec,
    ) -> Result<Vec<Box<dyn TeacherPolicy>>, WorkError> {
        let teacher = |index| load(self.teacher.as_ref(), input(inputs, index)?, None, spec);
        (0..self.tasks.len()).map(teacher).collect()
    }

    /// The stream of the candidate that is recorded next, its task, and the teacher for it.
    fn next(&self, taken: &Taken) -> (Seed, Task, usize) {
        let seed = self.seed.index((self.span.first + taken.recordings.len()) as u64);
        let source = TaskSource::Uniformly(self.tasks.clone());
        let (task, teacher) = source.draw(&mut seed.child("task").stream());
        (seed, task, teacher.unwrap_or_default())
    }

    /// Samples a random context `C_i = (τ, s0)`, executes `π*_τ` for `T` steps and records `h_i`, or that this take did not
    /// last.
    fn take_next(
        &self,
        arena: &mut Arena<'_>,
        teachers: &[Box<dyn TeacherPolicy>],
        taken: &mut Taken,
    ) -> Result<(), WorkError> {
        let (seed, task, teacher) = self.next(taken);
        let prices = arena.simulator()?.spec().prices(&task);
        let seed = seed.child("take").index(u64::from(taken.next.count));
        let start = arena.start(&self.initial_states, &task, &seed.child("start"))?;
        let context = Context { task, start };
        let (result, tape) = self.take(arena, teachers[teacher].as_ref(), &context, &seed)?;
        if result.ending != Ending::Horizon {
            return self.lasted_not(taken, &result.ending);
        }
        let Takes { count, failures, .. } = std::mem::take(&mut taken.next);
        taken.recordings.push(Recording {
            teacher,
            retakes: count,
            failures,
            teacher_return: price(&result.term_sums, &prices),
            demonstration: Some(Demonstration {
                observations: tape.observations,
                actions: tape.actions,
                steps: self.horizon.steps,
            }),
        });
        Ok(())
    }

    /// Notes that the next take ended before the horizon; gives the candidate up if it was the last one that it may have.
    fn lasted_not(&self, taken: &mut Taken, ending: &Ending) -> Result<(), WorkError> {
        let takes = &mut taken.next;
        takes.failures.extend(ending.trouble().map(|why| (takes.count, why.to_owned())));
        takes.failed += u32::from(matches!(ending, Ending::Failed(_)));
        takes.count += 1;
        if takes.count <= self.max_retakes && takes.lost < TRIES as u32 {
            return Ok(());
        }
        let (_, _, teacher) = self.next(taken);
        let Takes { count, failed, lost, failures } = std::mem::take(&mut taken.next);
        // A teacher of the user's own whose every take fails does not act at all.
        let acts_not = self.teacher.hosted().is_some() && failed > self.max_retakes;
        // Nor is there hope where the first candidates lose every worker.
        let none = taken.recordings.iter().all(|recording| recording.demonstration.is_none());
        let hopeless = lost == TRIES as u32 && none && taken.recordings.len() + 1 >= TRIES;
        match failures.last() {
            Some((_, why)) if acts_not || hopeless => Err(WorkError::Failed(why.clone())),
            _ => {
                let (retakes, teacher_return) = (count - 1, 0.0);
                let recording = Recording { teacher, retakes, failures, teacher_return, demonstration: None };
                taken.recordings.push(recording);
                Ok(())
            }
        }
    }

    /// Executes `π*_τ` once.
    fn take(
        &self,
        arena: &mut Arena<'_>,
        policy: &dyn TeacherPolicy,
        context: &Context,
        seed: &Seed,
    ) -> Result<(Rollout, Tape), WorkError> {
        let taken = arena.roll_out(|simulator| {
            let mut agent = Taught { policy, sampling: self.acts == TeacherActs::Sample };
            let mut tape = Tape::default();
            let setting = Setting { context, horizon: &self.horizon };
            let noise = &mut seed.child("noise").stream();
            let result = watched(simulator, &mut agent, setting, noise, &mut tape);
            (result, tape)
        })?;
        Ok(taken)
    }
}

/// Reads a teacher's result and makes its policy, or that of a snapshot on its way.
pub(super) fn load(
    config: &dyn TeacherConfig,
    bytes: &[u8],
    snapshot: Option<usize>,
    spec: &SimulatorSpec,
) -> Result<Box<dyn TeacherPolicy>, WorkError> {
    let trained = TeacherResult::decode(bytes)?
        .trained
        .ok_or_else(|| WorkError::Failed("this teacher's training diverged".to_owned()))?;
    let tensors = match snapshot {
        None => Some(&trained.policy),
        Some(index) => trained.snapshots.get(index).map(|snapshot| &snapshot.policy),
    };
    let tensors = tensors.ok_or_else(|| WorkError::Failed("this teacher has no such snapshot".to_owned()))?;
    config.load(tensors, spec).map_err(|error| WorkError::Failed(error.to_string()))
}

/// Take by take, candidate by candidate.
impl Piecewise for Record {
    type Done = Taken;

    fn begin(&self, _: &[Vec<u8>]) -> Result<Taken, WorkError> {
        Ok(Taken::default())
    }

    fn to_bytes(done: &Taken) -> Vec<u8> {
        codec::encode(&done.next, &[&encode(&done.recordings)])
    }

    fn from_bytes(bytes: &[u8]) -> Result<Taken, Malformed> {
        let (next, sections) = codec::decode(bytes)?;
        let [recordings] = sections[..] else {
            return Err(Malformed(format!("recordings in {} sections", sections.len())));
        };
        Ok(Taken { recordings: decode(recordings)?, next })
    }

    fn result(&self, done: &Taken) -> Option<Vec<u8>> {
        (done.recordings.len() == self.span.count).then(|| encode(&done.recordings))
    }

    fn give_up_next(&self, done: &mut Taken, reason: &str) -> Result<(), WorkError> {
        done.next.lost += 1;
        self.lasted_not(done, &Ending::failed(reason))
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    teacher: usize,
    retakes: u32,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    failures: Vec<(u32, String)>,
    teacher_return: f64,
    /// Steps, observation numbers, action numbers.
    recorded: Option<[usize; 3]>,
}

fn encode(recordings: &[Recording]) -> Vec<u8> {
    let heads: Vec<Head> = recordings
        .iter()
        .map(|r| Head {
            teacher: r.teacher,
            retakes: r.retakes,
            failures: r.failures.clone(),
            teacher_return: r.teacher_return,
            recorded: r.demonstration.as_ref().map(|d| [d.steps, d.observations.len(), d.actions.len()]),
        })
        .collect();
    let demonstrations = recordings.iter().filter_map(|r| r.demonstration.as_ref());
    let sections: Vec<Vec<u8>> = demonstrations
        .flat_map(|d| [codec::f32_bytes(&d.observations), codec::f32_bytes(&d.actions)])
        .collect();
    codec::encode(&heads, &sections.iter().map(Vec::as_slice).collect::<Vec<_>>())
}

/// Reads a unit's result: its recordings in order.
///
/// # Errors
/// [`Malformed`].
pub fn decode(bytes: &[u8]) -> Result<Vec<Recording>, Malformed> {
    let (heads, sections): (Vec<Head>, _) = codec::decode(bytes)?;
    let mut sections = sections.into_iter();
    let mut numbers = |count| {
        let section = sections.next().ok_or_else(|| Malformed("a recording is missing".to_owned()))?;
        codec::f32_numbers(section, count)
    };
    heads
        .into_iter()
        .map(|head| {
            let demonstration = match head.recorded {
                None => None,
                Some([steps, observations, actions]) => Some(Demonstration {
                    observations: numbers(observations)?,
                    actions: numbers(actions)?,
                    steps,
                }),
            };
            let Head { teacher, retakes, failures, teacher_return, .. } = head;
            Ok(Recording { teacher, retakes, failures, teacher_return, demonstration })
        })
        .collect()
}

impl From<Record> for Work {
    fn from(work: Record) -> Self {
        Self::Record(work)
    }
}
