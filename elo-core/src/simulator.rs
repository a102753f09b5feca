//! The contract between this crate and a physics engine (or any environment).
//!
//! # Implementing a simulator
//!
//! Write a config struct that implements [`SimulatorConfig`] and an engine object that implements [`Simulator`], add
//! the config to a [`crate::plugin::Plugin`] slice, and run [`crate::conformance::simulator`] on it. The contract:
//!
//! - **A trajectory is a function of (task, start, actions).** What the object did before must not matter, bit for
//!   bit; two objects built from one config behave alike.
//! - **Lengths are checked.** Buffers whose length is not what the spec says, actions with NaN or infinite components,
//!   and steps before a reset or after an end are errors that leave the object usable by the next `reset`.
//! - **An engine that lost its state says so.** A state that is not finite, a solver that ran out of memory, a silent
//!   reset: [`SimulatorError::Unstable`], never a plausible number.
//! - **`step` allocates nothing** and knows no time limit: those are the caller's.
//! - Actions outside the spec's bounds are clamped before they reach a motor; reward terms may see them unclamped.

use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::fault::Faults;
use crate::hosted::Hosted;
use crate::scene::Visible;
use crate::spec::SimulatorSpec;
use crate::task::Task;

/// One simulated world with one robot. Not shared between threads: each worker builds its own.
pub trait Simulator: Send {
    /// What the config's [`SimulatorConfig::spec`] says too.
    fn spec(&self) -> &SimulatorSpec;

    /// Puts the world at `start` under `task` and writes the first observation (`observation_size` numbers).
    ///
    /// # Errors
    /// A wrong length, a task outside the spec, a state of another robot, or a start that the engine cannot hold.
    fn reset(&mut self, task: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError>;

    /// Applies `action` for one control step; writes the observation after it and the step's reward terms, in the
    /// order of [`SimulatorSpec::reward_terms`]. On an end both are those of the ending step, and count.
    ///
    /// # Errors
    /// See [`SimulatorError`]; after one, only `reset` may be called.
    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError>;

    /// The present state, from which `reset` continues: the next observation and reward are those that would have come
    /// here, within the engine's stated tolerance.
    ///
    /// # Errors
    /// [`SimulatorError::Unsupported`] where the capabilities say so; an error before the first reset.
    fn state(&self) -> Result<State, SimulatorError>;

    /// What can be seen of it, if it has bodies to be drawn.
    fn visible(&self) -> Option<&dyn Visible> {
        None
    }
}

/// Where an episode begins.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Start {
    /// The robot's standard reset, whose noise comes from this number.
    Seed(u64),
    /// A state that [`Simulator::state`] returned, of this or of another engine with the same robot.
    State(State),
}

/// A robot's state in engine-independent terms, with everything else that observation and reward depend on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Generalised positions. For robots from MJCF files: MuJoCo's `qpos` (metres, radians, unit quaternions w first).
    pub positions: Vec<f64>,
    /// Generalised velocities. For robots from MJCF files: MuJoCo's `qvel` (a free root's linear part is that of its
    /// frame's origin in world axes, its angular part is in its own axes).
    pub velocities: Vec<f64>,
    /// What observation and reward remember besides, in an order that the simulator documents.
    pub memory: Vec<f64>,
    /// Control steps since the standard reset.
    pub elapsed: u64,
}

/// How a step left the episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// It goes on.
    Running,
    /// The task ended it: the robot fell. Nothing can be earned after this.
    Terminated,
    /// The environment cut it short for reasons of its own; more could have been earned.
    Truncated,
}

/// Why a simulator could not do what it was asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimulatorError {
    /// A buffer or vector has the wrong length.
    #[error("{what} has {got} numbers, expected {expected}")]
    Length {
        /// Which buffer.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length that the spec asks for.
        expected: usize,
    },
    /// An action component is NaN or infinite.
    #[error("action component {index} is {value}")]
    NonFiniteAction {
        /// Which component.
        index: usize,
        /// What it was.
        value: f32,
    },
    /// `step` before the first `reset`, after an end, or after an error.
    #[error("no episode is running: call reset first")]
    NoEpisode,
    /// The task is none of this simulator's.
    #[error("bad task: {0}")]
    Task(String),
    /// The start is none of this simulator's.
    #[error("bad start: {0}")]
    Start(String),
    /// The engine's numbers can no longer be trusted.
    #[error("the simulation is unstable: {0}")]
    Unstable(String),
    /// The simulator's capabilities exclude it.
    #[error("not supported by this simulator: {0}")]
    Unsupported(&'static str),
    /// Anything else that the engine reports.
    #[error("{0}")]
    Engine(String),
}

/// Checks a buffer's length.
///
/// # Errors
/// [`SimulatorError::Length`] when it differs.
pub fn check_length(what: &'static str, got: usize, expected: usize) -> Result<(), SimulatorError> {
    if got == expected { Ok(()) } else { Err(SimulatorError::Length { what, got, expected }) }
}

/// Checks that every component of an action is finite.
///
/// # Errors
/// [`SimulatorError::NonFiniteAction`] with the first that is not.
pub fn check_action(action: &[f32]) -> Result<(), SimulatorError> {
    match action.iter().position(|a| !a.is_finite()) {
        None => Ok(()),
        Some(index) => Err(SimulatorError::NonFiniteAction { index, value: action[index] }),
    }
}

/// Checks that what a simulator gave is numbers.
///
/// # Errors
/// [`SimulatorError::Unstable`] otherwise, which names the first that is none.
pub fn check_finite(observation: &[f32], reward_terms: &[f64]) -> Result<(), SimulatorError> {
    let unstable = |what: String| Err(SimulatorError::Unstable(what));
    if let Some(i) = observation.iter().position(|x| !x.is_finite()) {
        return unstable(format!("observation[{i}] is {}, which is not finite", observation[i]));
    }
    if let Some(i) = reward_terms.iter().position(|x| !x.is_finite()) {
        return unstable(format!("reward term {i} is {}, which is not finite", reward_terms[i]));
    }
    Ok(())
}

/// The inert description of a simulator, read from `[simulator]` of a config by its `kind`.
#[typetag::serde(tag = "kind")]
pub trait SimulatorConfig: fmt::Debug + Send + Sync {
    /// Replaces what refers to files (relative to `folder`) by their checked contents, so that the config means the
    /// same everywhere and its hash covers them. Called once, before `validate`.
    fn embed_files(&mut self, _folder: &Path, _faults: &mut Faults) {}

    /// Finds every fault of the fields, without the engine.
    fn validate(&self, faults: &mut Faults);

    /// The robot that it would build, without the engine.
    ///
    /// # Errors
    /// Whatever keeps the description from being read.
    fn spec(&self) -> Result<SimulatorSpec, BuildError>;

    /// Name and version of the engine: part of the key of everything that is computed with it.
    fn engine(&self) -> Engine;

    /// Where its code runs, if not in the caller's process.
    fn hosted(&self) -> Option<&dyn Hosted> {
        None
    }

    /// [`Self::hosted`], to be told what its worker says.
    fn hosted_mut(&mut self) -> Option<&mut dyn Hosted> {
        None
    }

    /// Makes a simulator in this process.
    ///
    /// # Errors
    /// [`BuildError::MissingEngine`] where this program was built without it.
    fn build(&self) -> Result<Box<dyn Simulator>, BuildError>;
}

/// Which engine, exactly.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Engine {
    /// e.g. `mujoco`.
    pub name: String,
    /// e.g. `3.17.0`.
    pub version: String,
}

/// Why a simulator could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// The engine is not linked into this program or not installed.
    #[error("{engine} is missing: {remedy}")]
    MissingEngine {
        /// Which engine.
        engine: String,
        /// What to run.
        remedy: String,
    },
    /// The robot's description cannot be loaded.
    #[error("the robot cannot be loaded: {0}")]
    Robot(String),
    /// A user's code cannot be found or run.
    #[error("{0}")]
    Code(String),
}
