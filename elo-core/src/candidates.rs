//! Algorithm 1(a): tasks, teachers, recordings and the candidates that are learned from them; or sets that are learned by
//! practice. Called from [`crate::discover`].

use std::collections::BTreeSet;

use crate::crew::{RunError, Unit};
use crate::discover::{Candidate, Origin, Run, Teacher, duplicate};
use crate::key::Key;
use crate::policy::Way;
use crate::seed::Seed;
use crate::task::Task;
use crate::units::Span;
use crate::units::apprentice::Apprentice;
use crate::units::learn::Learn;
use crate::units::practise::{Practise, SetResult};
use crate::units::record::{self, Record, Recording};
use crate::units::train::{TeacherResult, Train};

/// The recordings of one unit.
pub(crate) struct Recorded {
    /// Of which candidates.
    span: Span,
    /// The unit.
    key: Key,
    /// What it holds; teachers by their position among all.
    recordings: Vec<Recording>,
}

impl Recorded {
    /// How many of them did not fall.
    fn usable(&self) -> usize {
        self.recordings.iter().filter(|recording| recording.demonstration.is_some()).count()
    }

    /// The takes that failed: the recording's number, the take's number, and why.
    pub(crate) fn failed_takes(&self) -> impl Iterator<Item = (usize, u32, String)> {
        let numbered = self.span.items().zip(&self.recordings);
        numbered.flat_map(|(number, recording)| {
            recording.failures.iter().map(move |(take, why)| (number, *take, why.clone()))
        })
    }
}

/// Why there is nothing to learn from.
fn none_lasted(recorded: &[Recorded], steps: usize) -> RunError {
    let failed: Vec<_> = recorded.iter().flat_map(Recorded::failed_takes).collect();
    let recordings = recorded.iter().flat_map(|recorded| &recorded.recordings);
    let takes: u32 = recordings.map(|recording| recording.retakes + 1).sum();
    RunError::Config(match failed.first() {
        None => format!(
            "every recording of every teacher fell before {steps} steps: train longer or lower `discover.steps`"
        ),
        Some((.., why)) => format!(
            "every recording of every teacher ended before {steps} steps; {} of {takes} failed, the first one: {why}",
            failed.len()
        ),
    })
}

fn usable_keys(teachers: &[Teacher]) -> Vec<Key> {
    teachers.iter().filter(|teacher| teacher.usable).map(|teacher| teacher.key).collect()
}

impl Run<'_> {
    /// `W`.
    pub(crate) fn draw_tasks(&self) -> Vec<Task> {
        let seed = self.seed.child("tasks");
        let draw = |m| self.experiment.tasks.draw(&mut seed.index(m as u64).stream());
        (0..self.experiment.discover.teachers).map(draw).collect()
    }

    /// The training of a teacher for `task`, with its streams below `seed`.
    ///
    /// # Errors
    /// No `[teacher]`.
    pub fn training(&self, task: &Task, seed: Seed) -> Result<Unit, RunError> {
        let work = Train {
            simulator: duplicate(&self.experiment.simulator),
            teacher: self.teacher()?,
            task: task.clone(),
            initial_states: self.experiment.initial_states.clone(),
            seed,
        };
        Ok(Unit { work: work.into(), inputs: Vec::new() })
    }

    pub(crate) fn train_teachers(&self, tasks: &[Task]) -> Result<Vec<Teacher>, RunError> {
        let unit =
            |(m, task): (usize, &Task)| self.training(task, self.seed.child("teacher").index(m as u64));
        let units: Vec<Unit> = tasks.iter().enumerate().map(unit).collect::<Result<_, _>>()?;
        let keys = self.crew.complete("teachers", &units)?;
        let mut teachers = Vec::new();
        for (task, key) in tasks.iter().zip(keys) {
            let result = TeacherResult::decode(&self.crew.result(&key)?)?;
            let curve = result.trained.as_ref().map(|trained| trained.curve.as_slice()).unwrap_or_default();
            teachers.push(Teacher {
                task: task.clone(),
                key,
                diverged: result.diverged,
                usable: result.trained.is_some(),
                training_return: curve.iter().rev().find_map(|point| point.mean_return),
            });
        }
        let usable = teachers.iter().filter(|teacher| teacher.usable).count();
        let needed = self.experiment.discover.min_teachers.max(1);
        if usable < needed {
            let why: BTreeSet<&String> = teachers.iter().flat_map(|teacher| &teacher.diverged).collect();
            let why = why.into_iter().map(String::as_str).collect::<Vec<_>>().join("; ");
            return Err(RunError::Config(format!(
                "only {usable} of {} teachers could be trained and `discover.min_teachers` asks for {needed}: {why}",
                teachers.len()
            )));
        }
        Ok(teachers)
    }

    /// The stage that records candidates of the usable `teachers`, for some of them.
    fn recording(&self, teachers: &[Teacher], span: Span) -> Result<Record, RunError> {
        let sizes = &self.experiment.discover;
        let usable = teachers.iter().filter(|teacher| teacher.usable);
        Ok(Record {
            simulator: duplicate(&self.experiment.simulator),
            teacher: self.teacher()?,
            tasks: usable.map(|teacher| teacher.task.clone()).collect(),
            initial_states: self.experiment.initial_states.clone(),
            acts: sizes.teacher_acts,
            horizon: sizes.horizon(),
            max_retakes: sizes.max_retakes,
            span,
            seed: self.seed.child("candidate"),
        })
    }

    pub(crate) fn record_trajectories(&self, teachers: &[Teacher]) -> Result<Vec<Recorded>, RunError> {
        let unit = |span: Span| {
            let work = self.recording(teachers, span)?.into();
            Ok(Unit { work, inputs: usable_keys(teachers) })
        };
        let spans = self.experiment.recordings();
        let units = spans.iter().map(|span| unit(*span)).collect::<Result<Vec<Unit>, RunError>>()?;
        let keys = self.crew.complete("recordings", &units)?;
        let positions: Vec<usize> = (0..teachers.len()).filter(|m| teachers[*m].usable).collect();
        let recorded = |(span, key): (Span, Key)| {
            let mut recordings = record::decode(&self.crew.result(&key)?)?;
            for recording in &mut recordings {
                recording.teacher = positions[recording.teacher];
            }
            Ok(Recorded { span, key, recordings })
        };
        spans.into_iter().zip(keys).map(recorded).collect()
    }

    /// An option of each recording that did not fall; the numbers of those that did.
    pub(crate) fn learn_options(
        &self,
        teachers: &[Teacher],
        recorded: &[Recorded],
    ) -> Result<(Vec<Candidate>, Vec<usize>), RunError> {
        let unit = |Recorded { span, key, .. }: &Recorded| {
            let (learner, seed) = (duplicate(&self.experiment.option_learner), self.seed.child("option"));
            Ok(if let Way::Apprentices(_) = learner.way() {
                let work = Apprentice { learner, recording: self.recording(teachers, *span)?, seed };
                Unit { work: work.into(), inputs: [vec![*key], usable_keys(teachers)].concat() }
            } else {
                let work = Learn { learner, spec: self.spec.clone(), span: *span, seed };
                Unit { work: work.into(), inputs: vec![*key] }
            })
        };
        let units = recorded.iter().map(unit).collect::<Result<Vec<Unit>, RunError>>()?;
        let keys = self.crew.complete("options", &units)?;
        let (mut candidates, mut given_up) = (Vec::new(), Vec::new());
        for (Recorded { span, recordings, .. }, key) in recorded.iter().zip(keys) {
            for (item, recording) in recordings.iter().enumerate() {
                let number = span.first + item;
                if recording.demonstration.is_none() {
                    given_up.push(number);
                    continue;
                }
                let Recording { teacher, retakes, teacher_return, .. } = *recording;
                let origin = Origin::Recording { teacher, retakes, teacher_return };
                candidates.push(Candidate { number, origin, options: vec![(key, item)] });
            }
        }
        if candidates.is_empty() {
            return Err(none_lasted(recorded, self.experiment.discover.steps));
        }
        Ok((candidates, given_up))
    }

    /// Sets of options that are learned together; each begins from its own recordings where there are any.
    pub(crate) fn practise_sets(
        &self,
        recorded: &[Recorded],
    ) -> Result<(Vec<Candidate>, Vec<usize>), RunError> {
        let sizes = &self.experiment.discover;
        let unit = |number: usize| Unit {
            work: Practise {
                simulator: duplicate(&self.experiment.simulator),
                learner: duplicate(&self.experiment.option_learner),
                tasks: self.experiment.tasks.clone(),
                initial_states: self.experiment.initial_states.clone(),
                set_size: sizes.set_size,
                horizon: sizes.horizon(),
                seed: self.seed.child("set").index(number as u64),
            }
            .into(),
            inputs: recorded.get(number).map(|recorded| recorded.key).into_iter().collect(),
        };
        // A set whose recordings all fell has nothing to begin from.
        let (numbers, mut given_up): (Vec<usize>, Vec<usize>) = (0..sizes.candidates)
            .partition(|number| recorded.get(*number).is_none_or(|recorded| recorded.usable() > 0));
        if numbers.is_empty() {
            return Err(none_lasted(recorded, sizes.steps));
        }
        let units: Vec<Unit> = numbers.iter().map(|number| unit(*number)).collect();
        let keys = self.crew.complete("option sets", &units)?;
        let (mut candidates, mut diverged) = (Vec::new(), Vec::new());
        for (number, key) in numbers.into_iter().zip(keys) {
            let SetResult { options, story } = SetResult::decode(&self.crew.result(&key)?)?;
            if options.is_empty() {
                given_up.push(number);
                diverged.extend(story.diverged);
                continue;
            }
            let options = (0..options.len()).map(|item| (key, item)).collect();
            let recorded = recorded.get(number);
            let origin = Origin::Practice {
                story,
                clones: recorded.map_or(0, Recorded::usable),
                retakes: recorded.map_or(0, |recorded| recorded.recordings.iter().map(|r| r.retakes).sum()),
            };
            candidates.push(Candidate { number, origin, options });
        }
        given_up.sort_unstable();
        if candidates.is_empty() {
            let why = diverged.join("; ");
            return Err(RunError::Config(format!("no set could be learned, every training diverged: {why}")));
        }
        Ok((candidates, given_up))
    }
}
