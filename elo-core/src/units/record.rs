//! Algorithm 1(a), the loop: execute a teacher for `T` steps from a random context and record its trajectory.

use serde::{Deserialize, Serialize};

use super::arena::Arena;
use super::codec::{self, Malformed};
use super::prepare::TaskSource;
use super::train::TeacherResult;
use super::{Site, Span, Work, WorkError, input};
use crate::agent::Taught;
use crate::context::{Context, InitialStates, PreparedStart};
use crate::experiment::TeacherActs;
use crate::policy::{Demonstration, Monitor, TeacherConfig, TeacherPolicy};
use crate::rollout::{Ending, Horizon, Rollout, Setting, Tape, price, watched};
use crate::seed::Seed;
use crate::simulator::SimulatorConfig;
use crate::spec::SimulatorSpec;
use crate::task::Task;

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

impl Record {
    pub(super) fn perform(
        &self,
        inputs: &[Vec<u8>],
        site: &mut Site,
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        let mut arena = Arena::new(site, self.simulator.as_ref());
        let teachers = self.teachers(inputs, arena.simulator()?.spec())?;
        let mut recordings = Vec::with_capacity(self.span.count);
        for (_, seed) in self.span.seeds(&self.seed) {
            monitor.progress(recordings.len() as u64, self.span.count as u64)?;
            recordings.push(self.candidate(&mut arena, &teachers, &seed)?);
        }
        Ok(encode(&recordings))
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

    /// Samples a random context `C_i = (τ, s0)`, executes `π*_τ` for `T` steps and records `h_i`.
    fn candidate(
        &self,
        arena: &mut Arena<'_>,
        teachers: &[Box<dyn TeacherPolicy>],
        seed: &Seed,
    ) -> Result<Recording, WorkError> {
        let source = TaskSource::Uniformly(self.tasks.clone());
        let (task, teacher) = source.draw(&mut seed.child("task").stream());
        let teacher = teacher.unwrap_or_default();
        let prices = arena.simulator()?.spec().prices(&task);
        let policy = teachers[teacher].as_ref();
        let mut context = Context { task, start: PreparedStart::standard(0) };
        let (mut failures, mut failed) = (Vec::new(), 0);
        for take in 0..=self.max_retakes {
            let seed = seed.child("take").index(u64::from(take));
            context.start = arena.start(&self.initial_states, &context.task, &seed.child("start"))?;
            let (result, tape) = self.take(arena, policy, &context, &seed)?;
            if result.ending == Ending::Horizon {
                return Ok(Recording {
                    teacher,
                    retakes: take,
                    failures,
                    teacher_return: price(&result.term_sums, &prices),
                    demonstration: Some(Demonstration {
                        observations: tape.observations,
                        actions: tape.actions,
                        steps: self.horizon.steps,
                    }),
                });
            }
            failures.extend(result.ending.trouble().map(|why| (take, why.to_owned())));
            failed += u32::from(matches!(result.ending, Ending::Failed(_)));
        }
        // A teacher of the user's own whose every take fails does not act at all.
        match failures.pop() {
            Some((_, why)) if self.teacher.hosted().is_some() && failed > self.max_retakes => {
                Err(WorkError::Failed(why))
            }
            last => {
                failures.extend(last);
                let retakes = self.max_retakes;
                Ok(Recording { teacher, retakes, failures, teacher_return: 0.0, demonstration: None })
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
