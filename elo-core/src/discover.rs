//! Algorithm 1, *Construction of Early-Life Option Sets* (Weber et al. 2019, §4.4), from top to bottom.
//!
//! [`discover`] is the algorithm; each of its lines is a stage whose units are described in [`crate::units`].
//!
//! Option learners that practise (§6.2) learn whole sets. Then a candidate is a set: `N` of them are learned with seeds of
//! their own, each is measured as the infant agent that has it, and each metric picks the best one. An interest means
//! something only beside those of the same training, so options of different sets are never mixed, and random
//! `K`-subsets of all options are not among the baselines.

use std::ops::Range;

use crate::candidates::Recorded;
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
use crate::units::learn;
use crate::units::play::Play;
use crate::units::practise::Story;
use crate::units::prepare::{self, Prepare, TaskSource};

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
    /// Candidates that were given up, by number: every recording fell or failed, or every training of the set diverged.
    pub given_up: Vec<usize>,
    /// Takes of recordings that failed: the recording's number, which is that of its candidate, the take's number, and why.
    pub failed_takes: Vec<(usize, u32, String)>,
    /// Every candidate's rollouts in the selecting contexts.
    pub rollouts: Vec<Vec<Rollout>>,
    /// The selecting contexts.
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
    Practice {
        /// What was seen on the way.
        story: Story,
        /// How many of its options began as clones of recordings.
        clones: usize,
        /// Recordings that fell and were taken again.
        retakes: u32,
    },
}

impl Candidate {
    /// The teacher's return while it was recorded.
    pub fn teacher_return(&self) -> Option<f64> {
        match self.origin {
            Origin::Recording { teacher_return, .. } => Some(teacher_return),
            Origin::Practice { .. } => None,
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
        Way::Imitates(_) | Way::Apprentices(_) => run.learn_options(&teachers, &recordings)?,
        //    Or learn N sets of K options that maximise J(θ) (Eq. 6.1).
        Way::Practises(_) => run.practise_sets(&recordings)?,
    };
    let failed_takes = recordings.iter().flat_map(Recorded::failed_takes).collect();
    // 3. Return the candidates.

    // (b) Estimate the return distribution of candidates: execute each in Z random contexts, common to all. The selector
    //     says which candidates in which of them, as it selects.
    let contexts =
        run.prepare_contexts(Split::Select, experiment.discover.contexts, &run.selection_tasks(&teachers))?;

    // (c) Select the top K candidates by each metric ψ, or the best set.
    let pool = Pool { candidates: &candidates, contexts: &contexts };
    let (selection, rollouts) = run.select(&pool, &experiment.metrics, &experiment.returns)?;
    Ok(Discovery {
        spec: run.spec.clone(),
        teachers,
        candidates,
        given_up,
        failed_takes,
        rollouts,
        contexts,
        selection,
    })
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

    /// `[teacher]`, for stages that cannot do without.
    ///
    /// # Errors
    /// There is none.
    pub fn teacher(&self) -> Result<Box<dyn TeacherConfig>, RunError> {
        let none = || RunError::Config(format!("`teacher`: {NO_TEACHER}"));
        self.experiment.teacher.as_ref().map(duplicate).ok_or_else(none)
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
