//! The configuration of one run, as a TOML file writes it. Every default is the paper's where the paper gives one, but for
//! [`Discover::tasks`]: contexts to select in have tasks from `P`, as held-out contexts have, which needs no teachers. The presets of
//! the paper (`examples/paper`) set its `W`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::context::InitialStates;
use crate::discover::{RECORDINGS_PER_UNIT, duplicate};
use crate::experiments::ExperimentsPlan;
use crate::fault::Faults;
use crate::hosted::Hosted;
use crate::metric::Metric;
use crate::policy::{OptionLearner, TeacherConfig, Way};
use crate::returns::{FailureRule, Normaliser, ReturnScaling};
use crate::rollout::Horizon;
use crate::select::Selector;
use crate::simulator::SimulatorConfig;
use crate::task::TaskDistribution;
use crate::units::Span;
use crate::units::describe::Describe;
use crate::workers::Workers;

/// What is said where a teacher is missing.
pub(crate) const NO_TEACHER: &str = "is missing; expected a table [teacher]: the option learner learns from what teachers do (`elo plugins` lists them)";

/// One run: from a simulator and a task family to selected option sets.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// The root of every random draw. The same config and seed give the same bytes.
    pub seed: u64,
    /// Which robot, in which engine; see `elo plugins`.
    pub simulator: Box<dyn SimulatorConfig>,
    /// `P`: the range from which each task parameter is drawn uniformly, e.g. `electricity_cost = { low = -2.4, high =
    /// -1.4 }` (§5.1). Parameters without a range keep the simulator's default.
    #[serde(default)]
    pub tasks: TaskDistribution,
    /// `d0`: where contexts begin (§5.1).
    #[serde(default)]
    pub initial_states: InitialStates,
    /// How near-optimal policies are found (Algorithm 1(a), step 2); see `elo plugins`. Option learners that practise by
    /// themselves do without; where there is one all the same, it is what `elo experiments` compares with. A training that diverges,
    /// or that ends with a teacher which earns significantly less than random torque (30 paired rollouts of at most 200 steps), is
    /// tried again with another seed, three times in all; then the teacher is left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub teacher: Option<Box<dyn TeacherConfig>>,
    /// How options are learned: from recorded trajectories one by one, or a whole set by practice; see `elo plugins`.
    pub option_learner: Box<dyn OptionLearner>,
    /// The sizes of Algorithm 1.
    #[serde(default)]
    pub discover: Discover,
    /// The metrics `ψ`, each of which selects its own set; see `elo plugins`.
    pub metrics: Vec<Box<dyn Metric>>,
    /// How candidates are measured and eliminated; see `elo plugins`.
    #[serde(default = "uniform")]
    pub selector: Box<dyn Selector>,
    /// How returns are scaled before metrics see them.
    #[serde(default)]
    pub returns: ReturnScaling,
    /// What a failed rollout counts as.
    #[serde(default)]
    pub failures: FailureRule,
    /// What is measured on fresh contexts at the end.
    #[serde(default)]
    pub report: ReportPlan,
    /// What `elo experiments` measures besides.
    #[serde(default)]
    pub experiments: ExperimentsPlan,
    /// Which programs do work outside this process. Changes no result.
    #[serde(default)]
    pub workers: Workers,
}

fn uniform() -> Box<dyn Selector> {
    Box::new(crate::select::Uniform {})
}

/// The sizes of Algorithm 1: `[discover]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Discover {
    /// `M`: tasks drawn from `P`, each with its own teacher. The paper says "small".
    #[schemars(range(min = 1, max = 10000))]
    pub teachers: usize,
    /// Fewest teachers to go on with when trainings diverge; at least 1.
    #[schemars(range(min = 1))]
    pub min_teachers: usize,
    /// `N`: candidate options. The paper uses 600. With an option learner that practises: candidate sets, each from a
    /// training of its own, of which a metric picks one; a few.
    #[schemars(range(min = 1, max = 1000000))]
    pub candidates: usize,
    /// `Z`: contexts in which each candidate is measured; at least `set_size`. The paper uses 300.
    #[schemars(range(min = 1, max = 1000000))]
    pub contexts: usize,
    /// `T`: control steps of one option. The paper uses 200, which is 3.3 s. With an option learner that practises: control steps of
    /// one rollout at most, in practice and when measured; its options end by chance, and several may run in one rollout.
    #[schemars(range(min = 1, max = 100000))]
    pub steps: usize,
    /// `K`: options in a set; at most `candidates`, unless the option learner practises. The paper uses 5.
    #[schemars(range(min = 1))]
    pub set_size: usize,
    /// Where the tasks of selecting contexts come from. The paper draws them from the teachers' tasks `W`; the default is `P`, from
    /// which held-out contexts are drawn too, and which needs no teachers.
    pub tasks: EvaluationTasks,
    /// Whether a teacher is recorded acting by its mean or sampling.
    pub teacher_acts: TeacherActs,
    /// `γ` of returns, in (0, 1]. Reward-term sums are stored with it, so it is fixed for a run.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub discount: f64,
    /// Whether a fall ends the return; its step's reward counts, nothing after it.
    pub stop_at_fall: bool,
    /// How often a recording that fell before its end is taken again, from another start, before the candidate is given
    /// up; the paper does not say.
    pub max_retakes: u32,
}

impl Default for Discover {
    fn default() -> Self {
        Self {
            teachers: 10,
            min_teachers: 1,
            candidates: 600,
            contexts: 300,
            steps: 200,
            set_size: 5,
            tasks: EvaluationTasks::P,
            teacher_acts: TeacherActs::Mean,
            discount: 1.0,
            stop_at_fall: true,
            max_retakes: 20,
        }
    }
}

impl Discover {
    /// The horizon of every rollout that selects or reports.
    pub fn horizon(&self) -> Horizon {
        Horizon { steps: self.steps, discount: self.discount, stop_at_fall: self.stop_at_fall }
    }
}

/// See [`Discover::tasks`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum EvaluationTasks {
    /// New tasks from `P`.
    P,
    /// Uniformly from the teachers' tasks, as Algorithm 1(b) is printed.
    W,
}

/// See [`Discover::teacher_acts`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TeacherActs {
    /// The mean of its policy.
    Mean,
    /// A sample of its policy.
    Sample,
}

/// What is measured on fresh contexts at the end: `[report]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReportPlan {
    /// Held-out contexts, drawn from `P` and `d0`, in which every reported figure is measured.
    #[schemars(range(min = 2, max = 1000000))]
    pub contexts: usize,
    /// Random `K`-subsets of the candidates that selected sets are compared with; none where sets are learned as a whole.
    #[schemars(range(min = 1, max = 10000))]
    pub random_subsets: usize,
    /// `α` of the reported lower tail `Pr(V < μ* − α σ*)`; at least 0. The paper does not give it.
    #[schemars(range(min = 0.0))]
    pub alpha: f64,
    /// Bootstrap draws behind each interval.
    #[schemars(range(min = 100, max = 100000))]
    pub bootstrap_draws: usize,
    /// Coverage of the intervals.
    #[schemars(range(min = 0.5, max = 0.999))]
    pub confidence: f64,
}

impl Default for ReportPlan {
    fn default() -> Self {
        Self { contexts: 300, random_subsets: 10, alpha: 1.0, bootstrap_draws: 2000, confidence: 0.95 }
    }
}

impl Experiment {
    /// Finds every fault that only the whole config shows, and those that plugins find in their own tables. Ranges of
    /// single fields have been checked against the schema before.
    pub fn validate(&self, faults: &mut Faults) {
        let before = faults.found().len();
        faults.within("simulator", |faults| self.simulator.validate(faults));
        let told = faults.found().len() > before;
        if let Some(teacher) = &self.teacher {
            faults.within("teacher", |faults| teacher.validate(faults));
        }
        faults.within("option_learner", |faults| self.option_learner.validate(faults));
        faults.within("selector", |faults| self.selector.validate(faults));
        faults.within("failures", |faults| self.failures.validate(faults));
        self.validate_metrics(faults);
        faults.within("discover", |faults| self.discover.validate(faults));
        self.validate_way(faults);
        faults.within("workers", |faults| self.workers.validate(faults));
        faults.within("experiments", |faults| self.experiments.validate(faults));
        faults.within("report", |faults| {
            let plan = &self.report;
            faults.check(plan.alpha.is_finite(), "alpha", || {
                format!("expected a finite number, got {}", plan.alpha)
            });
        });
        match self.simulator.spec() {
            Ok(spec) => {
                faults.within("tasks", |faults| self.tasks.validate(&spec, faults));
                faults.within("initial_states", |faults| self.initial_states.validate(&spec, faults));
                let possible = self.discover.stop_at_fall || spec.capabilities.settable_state;
                faults.check(possible, "discover.stop_at_fall", || {
                    "false needs a simulator whose state can be set".to_owned()
                });
            }
            // The simulator's own table says it better.
            Err(_) if told => {}
            Err(error) => faults.add("simulator", error.to_string()),
        }
    }

    /// Whether the run trains teachers and records them.
    pub fn records(&self) -> bool {
        match self.option_learner.way() {
            Way::Imitates(_) | Way::Apprentices(_) => true,
            Way::Practises(learner) => learner.begins_from_recordings(),
        }
    }

    /// How many candidates the best of which make a set: `K` options, or one set that was learned as a whole.
    pub fn candidates_of_a_set(&self) -> usize {
        match self.option_learner.way() {
            Way::Imitates(_) | Way::Apprentices(_) => self.discover.set_size,
            Way::Practises(_) => 1,
        }
    }

    /// The recordings of each unit: of some candidates, or all those that one set begins from. None where nothing is recorded.
    pub fn recordings(&self) -> Vec<Span> {
        let Discover { candidates, set_size, .. } = self.discover;
        match self.option_learner.way() {
            _ if !self.records() => Vec::new(),
            Way::Imitates(_) | Way::Apprentices(_) => Span::cut(candidates, RECORDINGS_PER_UNIT),
            Way::Practises(_) => Span::cut(candidates * set_size, set_size),
        }
    }

    /// What one way of learning options needs and another does not.
    fn validate_way(&self, faults: &mut Faults) {
        faults.check(self.teacher.is_some() || !self.records(), "teacher", || NO_TEACHER.to_owned());
        faults.check(self.discover.tasks == EvaluationTasks::P || self.records(), "discover.tasks", || {
            "expected \"P\", got \"W\": this option learner needs no teachers, so there are no tasks of theirs".to_owned()
        });
        let imitates = |learner: &dyn OptionLearner| !matches!(learner.way(), Way::Practises(_));
        let own = imitates(self.option_learner.as_ref());
        let Discover { candidates, set_size, .. } = self.discover;
        faults.check(!own || set_size <= candidates, "discover.set_size", || {
            format!("K = {set_size} options cannot be chosen from N = {candidates} candidates")
        });
        faults.check(own || self.returns.normaliser != Normaliser::Teacher, "returns.normaliser", || {
            "expected \"min_max\" or \"none\", got \"teacher\": this option learner imitates no teacher"
                .to_owned()
        });
        for (i, other) in self.experiments.other_learners.iter().enumerate() {
            faults.check(imitates(other.as_ref()) == own, &format!("experiments.other_learners[{i}]"), || {
                let (got, expected) =
                    if own { ("practises", "imitates recordings") } else { ("imitates recordings", "practises") };
                format!(
                    "{got}; expected a learner that {expected}, as `option_learner` does (`elo compare` compares two runs)"
                )
            });
        }
    }

    /// Every plugin, with the path of its table: those whose code may run in workers.
    pub fn describable(&self) -> Vec<(String, Describe)> {
        let metrics = self.metrics.iter().enumerate();
        let metrics =
            metrics.map(|(i, metric)| (format!("metrics[{i}]"), Describe::Metric(duplicate(metric))));
        let simulator = ("simulator".to_owned(), Describe::Simulator(duplicate(&self.simulator)));
        let teacher = self.teacher.as_ref();
        let teacher = teacher.map(|teacher| ("teacher".to_owned(), Describe::Teacher(duplicate(teacher))));
        std::iter::once(simulator).chain(teacher).chain(metrics).collect()
    }

    /// The plugins whose code runs in workers, in the order and with the paths of [`Self::describable`].
    pub fn hosted_mut(&mut self) -> Vec<(String, &mut dyn Hosted)> {
        let metrics = self.metrics.iter_mut().enumerate();
        let metrics = metrics.map(|(i, metric)| (format!("metrics[{i}]"), metric.hosted_mut()));
        let simulator = ("simulator".to_owned(), self.simulator.hosted_mut());
        let teacher = self.teacher.as_mut().map(|teacher| ("teacher".to_owned(), teacher.hosted_mut()));
        let all = std::iter::once(simulator).chain(teacher).chain(metrics);
        all.filter_map(|(path, hosted)| hosted.map(|hosted| (path, hosted))).collect()
    }

    fn validate_metrics(&self, faults: &mut Faults) {
        faults.check(!self.metrics.is_empty(), "metrics", || {
            "expected at least one [[metrics]] table".to_owned()
        });
        let labels: Vec<String> = self.metrics.iter().map(|metric| metric.label()).collect();
        for (i, metric) in self.metrics.iter().enumerate() {
            faults.within(&format!("metrics[{i}]"), |faults| {
                metric.validate(faults);
                faults.check(!labels[..i].contains(&labels[i]), "", || {
                    format!("is the same as an earlier metric: {}", labels[i])
                });
            });
        }
    }
}

impl Discover {
    fn validate(&self, faults: &mut Faults) {
        faults.check(self.contexts >= self.set_size, "contexts", || {
            format!("expected at least set_size = {} contexts, got {}", self.set_size, self.contexts)
        });
        faults.check(self.min_teachers <= self.teachers, "min_teachers", || {
            format!("expected at most teachers = {}, got {}", self.teachers, self.min_teachers)
        });
        faults.check(self.discount > 0.0, "discount", || "expected a number above 0, got 0".to_owned());
    }
}
