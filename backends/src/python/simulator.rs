//! An environment in Python as a simulator. Python's lock is held during its calls alone.

use elo_core::simulator::{
    BuildError, End, Simulator, SimulatorError, Start, State, check_action, check_finite, check_length,
};
use elo_core::spec::SimulatorSpec;
use elo_core::task::Task;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::config::{Described, PythonConfig};
use super::interpreter::{Shared, bridge, close, refused, told, unchanged};
use super::interruption::asked;
use super::watchdog::Call;

/// See the [module](super).
pub struct PythonSimulator {
    spec: SimulatorSpec,
    bridge: Py<PyAny>,
    /// `bridge.step`, looked up once.
    step: Py<PyAny>,
    /// Arrays that both sides see.
    action: Shared<f32>,
    observation: Shared<f32>,
    terms: Shared<f64>,
    /// The action as it is given to the environment.
    clipped: Vec<f32>,
    begun: bool,
    running: bool,
}

impl PythonSimulator {
    /// Makes the environment and asks it what it is.
    ///
    /// # Errors
    /// A target that cannot be imported or made, spaces that are no boxes, or another environment than `config`
    /// describes.
    pub fn new(config: &PythonConfig) -> Result<Self, BuildError> {
        let made = asked(|py| {
            let bridge = bridge(py, "environment", config)?;
            let described: String = bridge.call_method0("describe")?.extract()?;
            let (action, observation) = (Shared::of(&bridge, "action")?, Shared::of(&bridge, "observation")?);
            let (terms, step) = (Shared::of(&bridge, "terms")?, bridge.getattr("step")?.unbind());
            Ok((described, action, observation, terms, step, bridge.unbind()))
        });
        let (described, action, observation, terms, step, bridge) = made.map_err(refused)?;
        let described: Described =
            serde_json::from_str(&described).map_err(|error| BuildError::Code(error.to_string()))?;
        config.described.as_ref().map_or(Ok(()), |then| unchanged(&config.target, &described, then))?;
        let spec = config.spec_with(&described);
        Ok(Self {
            clipped: vec![0.0; spec.action_size()],
            spec,
            bridge,
            step,
            action,
            observation,
            terms,
            begun: false,
            running: false,
        })
    }

    /// Has the bridge take up a task's parameters, calls it, then copies what it saw into `observation`.
    fn begin(
        &self,
        parameters: Vec<f64>,
        observation: &mut [f32],
        call: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<()>,
    ) -> Result<(), SimulatorError> {
        let done = asked(|py| {
            let bridge = self.bridge.bind(py);
            bridge.call_method1("prepare", (parameters,))?;
            let _call = Call::begin();
            call(bridge)?;
            self.observation.read(py, observation)
        });
        done.map_err(|error| SimulatorError::Engine(told(&error)))?;
        check_finite(observation, &[])
    }
}

impl Drop for PythonSimulator {
    /// Closes the environment.
    fn drop(&mut self) {
        // None while the interpreter ends.
        Python::try_attach(|py| close(self.bridge.bind(py)));
    }
}

impl Simulator for PythonSimulator {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    fn reset(&mut self, task: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        self.running = false;
        check_length("observation", observation.len(), self.spec.observation_size)?;
        if let Some(fault) = self.spec.task_faults(task).into_iter().next() {
            return Err(SimulatorError::Task(fault));
        }
        let parameters: Vec<f64> =
            self.spec.task_parameters.iter().map(|p| self.spec.parameter_value(task, &p.name)).collect();
        match start {
            Start::Seed(seed) => self
                .begin(parameters, observation, |bridge| bridge.call_method1("reset", (*seed,)).map(drop))?,
            Start::State(_) if !self.spec.capabilities.settable_state => {
                return Err(SimulatorError::Unsupported("starting from a state"));
            }
            Start::State(state) => self.begin(parameters, observation, |bridge| {
                let given = PyDict::new(bridge.py());
                given.set_item("positions", PyArray1::from_slice(bridge.py(), &state.positions))?;
                given.set_item("velocities", PyArray1::from_slice(bridge.py(), &state.velocities))?;
                given.set_item("memory", PyArray1::from_slice(bridge.py(), &state.memory))?;
                bridge.call_method1("restore", (given, state.elapsed)).map(drop)
            })?,
        }
        (self.begun, self.running) = (true, true);
        Ok(())
    }

    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError> {
        // After any error, and after an end, only a reset goes on.
        if !std::mem::take(&mut self.running) {
            return Err(SimulatorError::NoEpisode);
        }
        check_length("action", action.len(), self.spec.action_size())?;
        check_length("observation", observation.len(), self.spec.observation_size)?;
        check_length("reward terms", reward_terms.len(), self.spec.reward_terms.len())?;
        check_action(action)?;
        self.clipped.copy_from_slice(action);
        self.spec.clip(&mut self.clipped);
        let end = asked(|py| -> PyResult<u8> {
            let _call = Call::begin();
            self.action.write(py, &self.clipped)?;
            let end = self.step.bind(py).call0()?.extract()?;
            self.observation.read(py, observation)?;
            self.terms.read(py, reward_terms)?;
            Ok(end)
        });
        let end = match end.map_err(|error| SimulatorError::Engine(told(&error)))? {
            0 => End::Running,
            1 => End::Terminated,
            _ => End::Truncated,
        };
        check_finite(observation, reward_terms)?;
        self.running = end == End::Running;
        Ok(end)
    }

    fn state(&self) -> Result<State, SimulatorError> {
        if !self.spec.capabilities.settable_state {
            return Err(SimulatorError::Unsupported("reading its state"));
        }
        if !self.begun {
            return Err(SimulatorError::NoEpisode);
        }
        let state = asked(|py| {
            let _call = Call::begin();
            let (positions, velocities, memory, elapsed) =
                self.bridge.bind(py).call_method0("state")?.extract()?;
            Ok(State { positions, velocities, memory, elapsed })
        });
        state.map_err(|error| SimulatorError::Engine(told(&error)))
    }
}
