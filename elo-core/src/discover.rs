//! Algorithm 1, *Construction of Early-Life Option Sets* (Weber et al. 2019, §4.4), from top to bottom.
//!
//! [`discover`] is the algorithm; each of its lines is a stage whose units are described in [`crate::units`].
//!
//! Option learners that practise (§6.2) learn whole sets. Then a candidate is a set: `N` of them are learned with seeds of
//! their own, each is measured as the infant agent that has it, and each metric picks the best one. An interest means
//! something only beside those of the same training, so options of different sets are never mixed, and random
//! `K`-subsets of all options are not among the baselines.

use std::ops::Range;

use crate::context::Split;
use crate::crew::{Crew, RunError, Unit};
use crate::experiment::{EvaluationTasks, Experiment, NO_TEACHER};
use crate::key::Key;
use crate::measured::Pool;
use crate::performer::Performer;
use crate::policy::{PolicyRecord, TeacherConfig, Way};
use crate::rollout::{Rollout, price};
use crate::seed::Seed;
use crate::select::Selection;
use crate::spec::SimulatorSpec;
use crate::task::Task;
use crate::units::Span;
use crate::units::evaluate::{Evaluate, RolloutTable, Subject};
use crate::units::learn::{self, Learn};
use crate::units::play::Play;
use crate::units::practise::{Practise, SetResult, Story};
use crate::units::prepare::{self, Prepare, TaskSource};
use crate::units::record::{self, Record, Recording};
use crate::units::train::{TeacherResult, Train};

/// Contexts of one unit. Candidates are measured in whole blocks of so many contexts.
pub const CONTEXTS_PER_UNIT: usize = 50;

/// Recordings, and the options that imitate them, of one unit.
pub const RECORDINGS_PER_UNIT: usize = 10;

/// Candidates of one unit of rollouts.
pub const CANDIDATES_PER_UNIT: usize = 5;

/// Everything that Algorithm 1 found.
#[derive(Debug)]
pub struct Discovery {
    /// What the simulator says about itself.
    pub spec: SimulatorSpec,
    /// `W`, with what came of each training.
    pub teachers: Vec<Teacher>,
    /// The candidates that have an option.
    pub candidates: Vec<Candidate>,
    /// Candidates that were given up, by number: every recording fell, or every training of the set diverged.
    pub given_up: Vec<usize>,
    /// Every candidate's rollouts in the selection contexts.
    pub rollouts: Vec<Vec<Rollout>>,
    /// The selection contexts.
    pub contexts: ContextSet,
    /// The chosen sets; candidates by their position in `candidates`.
    pub selection: Selection,
}

/// One task of `W` and its teacher.
#[derive(Clone, Debug)]
pub struct Teacher {
    /// `τ`.
    pub task: Task,
    /// The unit that holds it.
    pub key: Key,
    /// Why attempts were given up.
    pub diverged: Vec<String>,
    /// Whether there is a teacher.
    pub usable: bool,
    /// Mean return of the last training episodes, if it was measured.
    pub training_return: Option<f64>,
}

/// One candidate: an option, or a set of options that were learned together.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Its number `i` among the `N`.
    pub number: usize,
    /// Where it comes from.
    pub origin: Origin,
    /// The units that hold its options, and which of theirs.
    pub options: Vec<(Key, usize)>,
}

/// Where a candidate comes from.
#[derive(Clone, Debug)]
pub enum Origin {
    /// A recording of a teacher.
    Recording {
        /// The teacher, by its position in [`Discovery::teachers`].
        teacher: usize,
        /// Recordings that fell and were taken again.
        retakes: u32,
        /// The teacher's return while it was recorded.
        teacher_return: f64,
    },
    /// Rollouts of its own.
    Practice(Story),
}

impl Candidate {
    /// The teacher's return while it was recorded.
    pub fn teacher_return(&self) -> Option<f64> {
        match self.origin {
            Origin::Recording { teacher_return, .. } => Some(teacher_return),
            Origin::Practice(_) => None,
        }
    }
}

/// The contexts of one split.
#[derive(Clone, Debug)]
pub struct ContextSet {
    /// Which split.
    pub split: Split,
    /// The units that hold them, in blocks of [`CONTEXTS_PER_UNIT`].
    pub keys: Vec<Key>,
    /// How many.
    pub count: usize,
    /// What each context's task pays for the reward terms.
    pub prices: Vec<Vec<f64>>,
    /// Random control steps before each start.
    pub random_steps: Vec<u32>,
    /// How often the random policy of each start fell.
    pub redraws: Vec<u32>,
    /// The tasks.
    pub tasks: Vec<Task>,
}

/// Constructs early-life option sets, doing only what the crew's run directory does not hold yet.
///
/// # Errors
/// See [`RunError`].
pub fn discover(experiment: &Experiment, crew: &Crew<'_>) -> Result<Discovery, RunError> {
    let run = Run::new(experiment, crew)?;

    // (a) Generate candidates.
    let (mut teachers, mut recordings) = (Vec::new(), Vec::new());
    if experiment.records() {
        // 1. Draw a small set W of tasks {τ_1, …, τ_M} from P.
        let tasks = run.draw_tasks();
        // 2. Compute a near-optimal policy π*_τ for each task in W.
        teachers = run.train_teachers(&tasks)?;
        //    For i from 1 to N: sample a random context, execute π*_τ for T steps, record h_i …
        recordings = run.record_trajectories(&teachers)?;
    }
    let (candidates, given_up) = match experiment.option_learner.way() {
        //    … and define an option that reproduces the behaviour in h_i.
        Way::Imitates(_) => run.learn_options(&recordings)?,
        //    Or learn N sets of K options that maximise J(θ) (Eq. 6.1).
        Way::Practises(_) => run.practise_sets(&recordings)?,
    };
    // 3. Return the candidates.

    // (b) Estimate the return distribution of candidates: execute each in Z random contexts, common to all. The selector
    //     says which candidates in which of them, as it selects.
    let contexts =
        run.prepare_contexts(Split::Select, experiment.discover.contexts, &run.selection_tasks(&teachers))?;

    // (c) Select the top K candidates by each metric ψ, or the best set.
    let pool = Pool { candidates: &candidates, contexts: &contexts };
    let (selection, rollouts) = run.select(&pool, &experiment.metrics, &experiment.returns)?;
    Ok(Discovery { spec: run.spec.clone(), teachers, candidates, given_up, rollouts, contexts, selection })
}

/// What every stage of one run needs.
pub struct Run<'a> {
    /// The config.
    pub experiment: &'a Experiment,
    /// Who does the work.
    pub crew: &'a Crew<'a>,
    /// The simulator's description.
    pub spec: SimulatorSpec,
    /// The root of all streams.
    pub seed: Seed,
}

impl<'a> Run<'a> {
    /// A run of `experiment`.
    ///
    /// # Errors
    /// A robot that cannot be described.
    pub fn new(experiment: &'a Experiment, crew: &'a Crew<'a>) -> Result<Self, RunError> {
        let spec = experiment.simulator.spec().map_err(|error| RunError::Config(error.to_string()))?;
        Ok(Self { experiment, crew, spec, seed: Seed::root(experiment.seed) })
    }

    /// `W`.
    fn draw_tasks(&self) -> Vec<Task> {
        let seed = self.seed.child("tasks");
        let draw = |m| self.experiment.tasks.draw(&mut seed.index(m as u64).stream());
        (0..self.experiment.discover.teachers).map(draw).collect()
    }

    /// `[teacher]`, for stages that cannot do without.
    ///
    /// # Errors
    /// There is none.
    pub fn teacher(&self) -> Result<Box<dyn TeacherConfig>, RunError> {
        let none = || RunError::Config(format!("`teacher`: {NO_TEACHER}"));
        self.experiment.teacher.as_ref().map(duplicate).ok_or_else(none)
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

    fn train_teachers(&self, tasks: &[Task]) -> Result<Vec<Teacher>, RunError> {
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
            let why: Vec<String> = teachers.iter().flat_map(|teacher| teacher.diverged.clone()).collect();
            let why = why.join("; ");
            return Err(RunError::Config(format!(
                "only {usable} of {} teachers could be trained and `discover.min_teachers` asks for {needed}: {why}",
                teachers.len()
            )));
        }
        Ok(teachers)
    }

    fn record_trajectories(&self, teachers: &[Teacher]) -> Result<Vec<(Key, Vec<Recording>)>, RunError> {
        let usable = || teachers.iter().filter(|teacher| teacher.usable);
        let sizes = &self.experiment.discover;
        let teacher = self.teacher()?;
        let unit = |span: Span| Unit {
            work: Record {
                simulator: duplicate(&self.experiment.simulator),
                teacher: duplicate(&teacher),
                tasks: usable().map(|teacher| teacher.task.clone()).collect(),
                initial_states: self.experiment.initial_states.clone(),
                acts: sizes.teacher_acts,
                horizon: sizes.horizon(),
                max_retakes: sizes.max_retakes,
                span,
                seed: self.seed.child("candidate"),
            }
            .into(),
            inputs: usable().map(|teacher| teacher.key).collect(),
        };
        let units: Vec<Unit> = self.experiment.recordings().into_iter().map(unit).collect();
        let keys = self.crew.complete("recordings", &units)?;
        let positions: Vec<usize> = (0..teachers.len()).filter(|m| teachers[*m].usable).collect();
        keys.into_iter()
            .map(|key| {
                let mut recordings = record::decode(&self.crew.result(&key)?)?;
                for recording in &mut recordings {
                    recording.teacher = positions[recording.teacher];
                }
                Ok((key, recordings))
            })
            .collect()
    }

    fn learn_options(
        &self,
        recordings: &[(Key, Vec<Recording>)],
    ) -> Result<(Vec<Candidate>, Vec<usize>), RunError> {
        let spans = self.experiment.recordings();
        let unit = |(span, (key, _)): (&Span, &(Key, _))| Unit {
            work: Learn {
                learner: duplicate(&self.experiment.option_learner),
                spec: self.spec.clone(),
                span: *span,
                seed: self.seed.child("option"),
            }
            .into(),
            inputs: vec![*key],
        };
        let units: Vec<Unit> = spans.iter().zip(recordings).map(unit).collect();
        let keys = self.crew.complete("options", &units)?;
        let (mut candidates, mut given_up) = (Vec::new(), Vec::new());
        for ((span, key), (_, recordings)) in spans.iter().zip(keys).zip(recordings) {
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
            return Err(RunError::Config(format!(
                "every recording of every teacher fell before {} steps: train longer or lower `discover.steps`",
                self.experiment.discover.steps
            )));
        }
        Ok((candidates, given_up))
    }

    /// Sets of options that are learned together; each begins from its own recordings where there are any.
    fn practise_sets(
        &self,
        recordings: &[(Key, Vec<Recording>)],
    ) -> Result<(Vec<Candidate>, Vec<usize>), RunError> {
        let sizes = &self.experiment.discover;
        let unit = |number: usize| Unit {
            work: Practise {
                simulator: duplicate(&self.experiment.simulator),
                learner: duplicate(&self.experiment.option_learner),
                tasks: self.experiment.tasks.clone(),
                initial_states: self.experiment.initial_states.clone(),
                set_size: sizes.set_size,
                steps: sizes.steps,
                seed: self.seed.child("set").index(number as u64),
            }
            .into(),
            inputs: recordings.get(number).map(|(key, _)| *key).into_iter().collect(),
        };
        let units: Vec<Unit> = (0..sizes.candidates).map(unit).collect();
        let keys = self.crew.complete("option sets", &units)?;
        let (mut candidates, mut given_up) = (Vec::new(), Vec::new());
        let mut diverged = Vec::new();
        for (number, key) in keys.into_iter().enumerate() {
            let SetResult { options, story } = SetResult::decode(&self.crew.result(&key)?)?;
            if options.is_empty() {
                given_up.push(number);
                diverged.extend(story.diverged);
                continue;
            }
            let options = (0..options.len()).map(|item| (key, item)).collect();
            candidates.push(Candidate { number, origin: Origin::Practice(story), options });
        }
        if candidates.is_empty() {
            let why = diverged.join("; ");
            return Err(RunError::Config(format!("no set could be learned, every training diverged: {why}")));
        }
        Ok((candidates, given_up))
    }

    fn selection_tasks(&self, teachers: &[Teacher]) -> TaskSource {
        match self.experiment.discover.tasks {
            EvaluationTasks::P => TaskSource::Distribution(self.experiment.tasks.clone()),
            EvaluationTasks::W => {
                TaskSource::Uniformly(teachers.iter().filter(|t| t.usable).map(|t| t.task.clone()).collect())
            }
        }
    }

    /// Reaches the starts of the first `count` contexts of a split.
    ///
    /// # Errors
    /// See [`RunError`].
    pub fn prepare_contexts(
        &self,
        split: Split,
        count: usize,
        tasks: &TaskSource,
    ) -> Result<ContextSet, RunError> {
        let unit = |span: Span| Unit {
            work: Prepare {
                simulator: duplicate(&self.experiment.simulator),
                tasks: tasks.clone(),
                initial_states: self.experiment.initial_states.clone(),
                span,
                seed: split.seed(&self.seed),
            }
            .into(),
            inputs: Vec::new(),
        };
        let units: Vec<Unit> = Span::cut(count, CONTEXTS_PER_UNIT).into_iter().map(unit).collect();
        let keys = self.crew.complete(&format!("{} contexts", split.name()), &units)?;
        let mut contexts = Vec::with_capacity(count);
        for key in &keys {
            contexts.extend(prepare::decode(&self.crew.result(key)?)?);
        }
        Ok(ContextSet {
            split,
            keys,
            count,
            prices: contexts.iter().map(|context| self.spec.prices(&context.task)).collect(),
            random_steps: contexts.iter().map(|context| context.start.random_steps).collect(),
            redraws: contexts.iter().map(|context| context.start.redraws).collect(),
            tasks: contexts.into_iter().map(|context| context.task).collect(),
        })
    }

    /// The return of a rollout that earns the simulator's reward floor at every step of the horizon.
    pub fn return_floor(&self) -> f64 {
        let sizes = &self.experiment.discover;
        let steps: f64 = (0..sizes.steps).map(|i| sizes.discount.powi(i as i32)).sum();
        self.spec.reward_floor * steps
    }

    /// Runs each group of subjects in some blocks of contexts; gives every subject's rollouts in order, over those
    /// blocks. Subjects of one group share units.
    ///
    /// # Errors
    /// See [`RunError`].
    pub fn evaluate(
        &self,
        stage: &str,
        groups: &[Vec<Performer>],
        contexts: &ContextSet,
        blocks: Range<usize>,
    ) -> Result<Vec<Vec<Rollout>>, RunError> {
        let unit = |group: &[Performer], block: usize| {
            let (work, inputs) = self.rollouts(group, contexts, block);
            Unit { work: work.into(), inputs }
        };
        let units: Vec<Unit> =
            groups.iter().flat_map(|g| blocks.clone().map(|block| unit(g, block))).collect();
        let keys = self.crew.complete(stage, &units)?;
        let mut rollouts = Vec::new();
        for (group, keys) in groups.iter().zip(keys.chunks(blocks.len().max(1))) {
            let tables: Vec<RolloutTable> = keys
                .iter()
                .map(|key| Ok(RolloutTable::decode(&self.crew.result(key)?)?))
                .collect::<Result<_, RunError>>()?;
            let whole = |s: usize| tables.iter().flat_map(|table| table.row(s).iter().cloned()).collect();
            rollouts.extend((0..group.len()).map(whole));
        }
        Ok(rollouts)
    }

    /// Subjects on the run's own simulator, for as long as its options last.
    pub fn play(&self, subjects: Vec<Subject>, seed: Seed) -> Play {
        let simulator = duplicate(&self.experiment.simulator);
        Play { simulator, subjects, horizon: self.experiment.discover.horizon(), seed }
    }

    /// The rollouts of some subjects in one block of contexts, and the units that they need.
    pub(crate) fn rollouts(
        &self,
        group: &[Performer],
        contexts: &ContextSet,
        block: usize,
    ) -> (Evaluate, Vec<Key>) {
        let mut inputs = vec![contexts.keys[block]];
        let subjects = group.iter().map(|performer| performer.subject(&mut inputs)).collect();
        let seed = self.seed.child("rollout").child(contexts.split.name());
        let play = self.play(subjects, seed.child("block").index(block as u64));
        (Evaluate { contexts: 1, play }, inputs)
    }

    /// The options of a candidate.
    ///
    /// # Errors
    /// See [`RunError`].
    pub fn options(&self, candidate: &Candidate) -> Result<Vec<PolicyRecord>, RunError> {
        let none = || RunError::Config(format!("candidate {} has no option", candidate.number));
        let option = |(key, item): &(Key, usize)| {
            let options = learn::decode(&self.crew.result(key)?)?;
            options.into_iter().nth(*item).flatten().ok_or_else(none)
        };
        candidate.options.iter().map(option).collect()
    }
}

/// The return of a rollout under a task's prices; `None` when it failed.
pub fn value(rollout: &Rollout, prices: &[f64]) -> Option<f64> {
    rollout.ending.is_valid().then(|| price(&rollout.term_sums, prices))
}

/// A second copy of a plugin's config. Configs are plain data, so writing and reading one loses nothing.
pub fn duplicate<T>(config: &T) -> T
where
    T: serde::Serialize + serde::de::DeserializeOwned,
{
    let text = serde_json::to_string(config).expect("a config is plain data");
    serde_json::from_str(&text).expect("a config reads back what it wrote")
}
