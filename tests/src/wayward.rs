//! Plugins that go wrong, each in one way that its config declares. With the defaults they go right.

use std::fs::OpenOptions;
use std::sync::atomic::{AtomicU32, Ordering};

use elo_core::conformance::point_mass::{PointMassConfig, replay_only};
use elo_core::fault::Faults;
use elo_core::hosted::{Hosted, WorkerProgram};
use elo_core::plugin::Plugin;
use elo_core::policy::{
    Demonstration, Imitate, OptionLearner, OptionPolicy, PolicyFormat, PolicyRecord, Way,
};
use elo_core::seed::{Seed, Stream};
use elo_core::simulator::{
    BuildError, End, Engine, Simulator, SimulatorConfig, SimulatorError, Start, State,
};
use elo_core::spec::SimulatorSpec;
use elo_core::task::Task;
use elo_core::tensors::{TensorError, Tensors};
use elo_learners::open_loop::OpenLoopConfig;
use rand::RngExt as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The plugins of this file.
pub const PLUGINS: &[Plugin] = &[
    Plugin::simulator::<WaywardConfig>(
        "wayward",
        "the mass on a line, in an engine that goes wrong on demand",
    ),
    Plugin::option_learner::<WaywardLearner>(
        "wayward",
        "replays actions, or overdoes them, or gives no number",
    ),
    Plugin::policy_format(NOT_A_NUMBER),
];

/// The version that the engine gives itself; a test that raises it plays an upgrade.
pub static ENGINE_VERSION: AtomicU32 = AtomicU32::new(1);

/// The point mass in an engine that goes wrong.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WaywardConfig {
    /// As the point mass's.
    pub reset_spread: f64,
    /// Loses its state in about one start of ten (always the same ones) when the first action pushes to the right. Starts
    /// of the standard reset are spared, so that teachers can practise.
    pub unstable: bool,
    /// Reward terms are not a number in tasks whose mass is above 5.
    pub heavy_is_not_a_number: bool,
    /// Ends its process when an action is above 50, which no teacher does.
    pub dies: Dies,
    /// Cannot be put into states.
    pub replay_only: bool,
    /// Has its reward terms in the other order.
    pub reversed_terms: bool,
    /// Raises an exception at this step after each reset.
    pub raises_at: Option<u32>,
}

/// When the engine ends its process. Other than `never` it runs in the worker `elo-wayward-worker`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Dies {
    /// Not at all.
    Never,
    /// Each time.
    Always,
    /// Only while there is no file at this path, which it makes before it dies.
    Once(String),
}

impl Default for WaywardConfig {
    fn default() -> Self {
        Self {
            reset_spread: 0.5,
            unstable: false,
            heavy_is_not_a_number: false,
            dies: Dies::Never,
            replay_only: false,
            reversed_terms: false,
            raises_at: None,
        }
    }
}

impl WaywardConfig {
    fn point_mass(&self) -> PointMassConfig {
        PointMassConfig { reset_spread: self.reset_spread, ..PointMassConfig::default() }
    }
}

#[typetag::serde(name = "wayward")]
impl SimulatorConfig for WaywardConfig {
    fn validate(&self, faults: &mut Faults) {
        self.point_mass().validate(faults);
    }

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        let mut spec = self.point_mass().description();
        spec.capabilities.settable_state = !self.replay_only;
        if self.reversed_terms {
            spec.reward_terms.reverse();
        }
        Ok(spec)
    }

    fn engine(&self) -> Engine {
        Engine { name: "wayward".to_owned(), version: ENGINE_VERSION.load(Ordering::SeqCst).to_string() }
    }

    fn hosted(&self) -> Option<&dyn Hosted> {
        (self.dies != Dies::Never).then_some(self as &dyn Hosted)
    }

    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        let inner =
            if self.replay_only { replay_only(self.point_mass()) } else { self.point_mass().build()? };
        let (config, spec) = (self.clone(), self.spec()?);
        Ok(Box::new(Wayward { config, spec, inner, fragile: false, not_a_number: false, steps: 0 }))
    }
}

impl Hosted for WaywardConfig {
    fn worker(&self) -> WorkerProgram {
        WorkerProgram::Beside("elo-wayward-worker")
    }
}

struct Wayward {
    config: WaywardConfig,
    spec: SimulatorSpec,
    inner: Box<dyn Simulator>,
    /// The next action is the first after a start that can lose its state.
    fragile: bool,
    /// The task makes reward terms NaN.
    not_a_number: bool,
    /// Since the reset.
    steps: u32,
}

impl Simulator for Wayward {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    fn reset(&mut self, task: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        self.inner.reset(task, start, observation)?;
        self.steps = 0;
        self.fragile =
            self.config.unstable && matches!(start, Start::State(state) if is_among_a_tenth(state));
        self.not_a_number =
            self.config.heavy_is_not_a_number && task.get("mass").is_some_and(|mass| mass > 5.0);
        Ok(())
    }

    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError> {
        let end = self.inner.step(action, observation, reward_terms)?;
        if std::mem::take(&mut self.fragile) && action[0] > 0.0 {
            return Err(SimulatorError::Unstable("pushed to the right from a fragile start".to_owned()));
        }
        if action[0] > 50.0 {
            self.config.dies.perhaps();
        }
        self.steps += 1;
        if self.config.raises_at == Some(self.steps) {
            return Err(SimulatorError::Engine(format!("ValueError: step {}", self.steps)));
        }
        if self.not_a_number {
            reward_terms.fill(f64::NAN);
        }
        if self.config.reversed_terms {
            reward_terms.reverse();
        }
        Ok(end)
    }

    fn state(&self) -> Result<State, SimulatorError> {
        self.inner.state()
    }
}

fn is_among_a_tenth(state: &State) -> bool {
    // The last bits of a position are as good as random.
    state.positions.iter().any(|x| (x.to_bits() >> 3).is_multiple_of(10))
}

impl Dies {
    fn perhaps(&self) {
        let now = match self {
            Self::Never => false,
            Self::Always => true,
            Self::Once(marker) => OpenOptions::new().write(true).create_new(true).open(marker).is_ok(),
        };
        if now {
            eprintln!("ERROR: the engine overflowed its stack");
            std::process::exit(1);
        }
    }
}

/// Options that replay, but for some that go wrong. Which ones is drawn, each candidate by itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WaywardLearner {
    /// Share of the options whose every action is 3, thrice what the point mass can use.
    pub overdriven_share: f64,
    /// Share of the options whose every action is NaN.
    pub not_a_number_share: f64,
}

#[typetag::serde(name = "wayward")]
impl OptionLearner for WaywardLearner {
    fn validate(&self, _: &mut Faults) {}

    fn way(&self) -> Way<'_> {
        Way::Imitates(self)
    }
}

impl Imitate for WaywardLearner {
    fn learn(
        &self,
        demonstration: &Demonstration,
        spec: &SimulatorSpec,
        seed: &Seed,
    ) -> Result<Box<dyn OptionPolicy>, String> {
        let drawn = seed.stream().random::<f64>();
        let mut demonstration = demonstration.clone();
        if drawn < self.overdriven_share {
            demonstration.actions.fill(60.0);
        } else if drawn < self.overdriven_share + self.not_a_number_share {
            return Ok(Box::new(NotANumber));
        }
        OpenLoopConfig {}.learn(&demonstration, spec, seed)
    }
}

/// A policy whose actions are NaN.
#[derive(Clone, Copy, Debug)]
struct NotANumber;

const NOT_A_NUMBER: PolicyFormat = PolicyFormat {
    name: "not_a_number",
    summary: "no numbers; every action is NaN",
    load: |tensors: &Tensors, _: &SimulatorSpec| -> Result<Box<dyn OptionPolicy>, TensorError> {
        tensors.get("nothing").map(|_| Box::new(NotANumber) as Box<dyn OptionPolicy>)
    },
};

impl OptionPolicy for NotANumber {
    fn act(&self, _: &[f32], _: usize, _: &mut Stream, action: &mut [f32]) {
        action.fill(f32::NAN);
    }

    fn termination(&self, _: &[f32], _: usize) -> f64 {
        0.0
    }

    fn record(&self) -> PolicyRecord {
        let mut tensors = Tensors::new();
        tensors.insert("nothing", &[1], vec![0.0]);
        PolicyRecord { format: NOT_A_NUMBER.name.to_owned(), tensors }
    }
}
