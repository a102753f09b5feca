//! What a page is made of.

use elo_core::crosscheck::Crosscheck;
use elo_core::experiments::{AgentReturns, Experiments};
use elo_core::replay::Replay;
use elo_core::report::Report;
use elo_core::returns::FailurePolicy;

/// One page: one run or several.
#[derive(Clone, Debug)]
pub struct PageData {
    /// The runs, in the order of the page.
    pub runs: Vec<RunData>,
}

/// One finished run.
#[derive(Clone, Debug)]
pub struct RunData {
    /// What the page calls it; no two runs of a page have the same name.
    pub name: String,
    /// Its folder, as commands that the page suggests name it.
    pub folder: String,
    /// `results/report.json`.
    pub report: Report,
    /// What of the config the page speaks of.
    pub plan: Plan,
    /// `results/experiment.toml`.
    pub config: String,
    /// `results/provenance.json`.
    pub provenance: serde_json::Value,
    /// `results/candidates.csv`.
    pub candidates: Vec<CandidateRow>,
    /// `results/failures.csv`.
    pub failures: Vec<FailureRow>,
    /// `results/practice.csv`; empty where no set was learned by practice.
    pub practice: Vec<PracticeRow>,
    /// `results/experiments.json`, if there is one.
    pub experiments: Option<Experiments>,
    /// `results/crosscheck.json`, if there is one.
    pub crosscheck: Option<Crosscheck>,
    /// Films, engine by engine.
    pub replays: Vec<Replay>,
}

/// What the infant agent with one set earned in an iteration of its practice.
#[derive(Clone, Copy, Debug, serde::Deserialize)]
pub struct PracticeRow {
    /// The set's number.
    pub candidate: usize,
    /// Control steps until then.
    pub steps: f64,
    /// Mean return of the rollouts; none where none was whole.
    pub mean_return: Option<f64>,
    /// Their mean length in control steps.
    pub mean_length: Option<f64>,
}

/// The fields of a config that the page speaks of.
#[derive(Clone, Debug, serde::Deserialize)]
pub struct Plan {
    /// `[teacher]`, if there is one.
    pub teacher: Option<Teacher>,
    /// `[report]`.
    pub report: ReportFields,
    /// `[failures]`.
    pub failures: Failures,
}

/// See [`Plan`].
#[derive(Clone, Debug, serde::Deserialize)]
pub struct Teacher {
    /// The kind of teacher.
    pub kind: String,
}

/// See [`Plan`].
#[derive(Clone, Debug, serde::Deserialize)]
pub struct ReportFields {
    /// Coverage of the intervals.
    pub confidence: f64,
    /// `α` of the lower tail.
    pub alpha: f64,
}

/// See [`Plan`].
#[derive(Clone, Debug, serde::Deserialize)]
pub struct Failures {
    /// What a failed rollout counts as.
    pub policy: FailurePolicy,
    /// The greatest share of failed rollouts.
    pub max_share: f64,
}

/// A line of `candidates.csv`.
#[derive(Clone, Debug)]
pub struct CandidateRow {
    /// Its number.
    pub number: usize,
    /// Its score by each metric, in the order of the report's sets; `None` where it cannot be chosen.
    pub scores: Vec<Option<f64>>,
}

/// A line of `failures.csv`.
#[derive(Clone, Debug, serde::Deserialize)]
pub struct FailureRow {
    /// Which rollouts: `select`, `report_options`, `report_baselines` or `recordings`.
    pub table: String,
    /// The row in them; the number of a recording.
    pub row: usize,
    /// The context; the take of a recording.
    pub context: usize,
    /// Why.
    pub reason: String,
}

impl FailureRow {
    /// Whether it was a recording, which was taken again.
    pub fn is_of_a_recording(&self) -> bool {
        self.table == "recordings"
    }
}

impl RunData {
    /// The agent of that name in the experiments.
    pub fn agent(&self, name: &str) -> Option<&AgentReturns> {
        self.experiments.as_ref()?.agents.iter().find(|agent| agent.row.name == name)
    }

    /// The held-out returns of the set's option at `position`, out of those of the set's agent.
    pub fn option_returns(&self, metric: &str, position: usize) -> Option<Vec<f64>> {
        let set = self.report.sets.iter().find(|set| set.metric == metric)?;
        let (returns, members) = (&self.agent(metric)?.returns, set.options.len());
        let whole = returns.len() == members * self.report.starts.contexts && position < members;
        whole.then(|| returns.iter().skip(position).step_by(members).copied().collect())
    }

    /// How the page calls its teacher.
    pub fn teacher_name(&self) -> String {
        match self.plan.teacher.as_ref().map(|teacher| teacher.kind.as_str()) {
            Some("ppo") => "PPO".to_owned(),
            Some(kind) => format!("the teacher ({kind})"),
            None => "the teacher".to_owned(),
        }
    }
}
