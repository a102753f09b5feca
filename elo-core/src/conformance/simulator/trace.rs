//! Episodes that can be played again, and what came of playing them.

use super::{Case, Finding};
use crate::agent::{Agent as _, RandomTorque};
use crate::conformance::check::Violation;
use crate::conformance::compare::{granted, same};
use crate::seed::Seed;
use crate::simulator::{End, Simulator, Start, State};
use crate::spec::SimulatorSpec;
use crate::task::Task;

/// Everything that a trajectory is a function of.
#[derive(Clone, Debug)]
pub(super) struct Episode {
    pub task: Task,
    pub start: Start,
    pub actions: Vec<Vec<f32>>,
}

/// What one control step gave.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Moment {
    pub observation: Vec<f32>,
    pub terms: Vec<f64>,
    pub end: End,
}

/// What an episode gave: the first observation, then each step until its end or the last action.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Trace {
    pub first: Vec<f32>,
    pub moments: Vec<Moment>,
}

impl Episode {
    /// The default task from the standard reset `seed`, with `steps` uniformly random actions.
    pub fn random(spec: &SimulatorSpec, seed: u64, steps: usize) -> Self {
        let mut noise = Seed::root(seed).child("actions").stream();
        let mut agent = RandomTorque::new(spec);
        let mut action = || {
            let mut action = vec![0.0; spec.action_size()];
            agent.act(&[], &mut noise, &mut action);
            action
        };
        let actions = (0..steps).map(|_| action()).collect();
        Self { task: Task::default(), start: Start::Seed(seed), actions }
    }

    /// The same in another task.
    pub fn in_task(self, task: Task) -> Self {
        Self { task, ..self }
    }

    /// Resets `simulator` and takes the actions until the episode ends. Every buffer holds zeros when it is handed over.
    pub fn play(&self, simulator: &mut dyn Simulator) -> Result<Trace, Violation> {
        self.play_and(simulator, |_, _| Ok(()))
    }

    /// [`Self::play`], looking at the simulator before each step.
    pub fn play_and(
        &self,
        simulator: &mut dyn Simulator,
        mut look: impl FnMut(usize, &dyn Simulator) -> Result<(), Violation>,
    ) -> Result<Trace, Violation> {
        let first = begin(simulator, &self.task, &self.start)?;
        let mut moments = Vec::with_capacity(self.actions.len());
        for (step, action) in self.actions.iter().enumerate() {
            look(step, simulator)?;
            let moment = advance(simulator, action).map_err(|violation| violation.at(step))?;
            let over = moment.end != End::Running;
            moments.push(moment);
            if over {
                break;
            }
        }
        Ok(Trace { first, moments })
    }

    /// The states before each step of the trace, and the state after the last.
    pub fn states(&self, simulator: &mut dyn Simulator) -> Result<(Trace, Vec<State>), Violation> {
        let mut states = Vec::new();
        let trace = self.play_and(simulator, |step, simulator| {
            states.push(granted("state", simulator.state()).map_err(|violation| violation.at(step))?);
            Ok(())
        })?;
        states.push(granted("the state after the last step", simulator.state())?);
        Ok((trace, states))
    }
}

impl Trace {
    /// Asks that `other` is the same, bit for bit.
    pub fn same(&self, other: &Self) -> Result<(), Violation> {
        self.same_motion(other)?;
        for (step, (ours, theirs)) in self.moments.iter().zip(&other.moments).enumerate() {
            same("reward terms", &ours.terms, &theirs.terms).map_err(|violation| violation.at(step))?;
        }
        Ok(())
    }

    /// Asks for the same observations and ends, bit for bit; reward terms may differ.
    pub fn same_motion(&self, other: &Self) -> Result<(), Violation> {
        same("first observation", &self.first, &other.first)?;
        for (step, (ours, theirs)) in self.moments.iter().zip(&other.moments).enumerate() {
            same("observation", &ours.observation, &theirs.observation)
                .map_err(|violation| violation.at(step))?;
            if ours.end != theirs.end {
                let differ = Violation::new("end", format!("{:?}", ours.end), format!("{:?}", theirs.end));
                return Err(differ.at(step));
            }
        }
        if self.moments.len() == other.moments.len() {
            Ok(())
        } else {
            Err(Violation::new("length of the episode", self.moments.len(), other.moments.len()))
        }
    }
}

/// Resets `simulator`.
pub(super) fn begin(
    simulator: &mut dyn Simulator,
    task: &Task,
    start: &Start,
) -> Result<Vec<f32>, Violation> {
    let mut observation = vec![0.0; simulator.spec().observation_size];
    granted("reset", simulator.reset(task, start, &mut observation))?;
    Ok(observation)
}

/// Takes one step.
pub(super) fn advance(simulator: &mut dyn Simulator, action: &[f32]) -> Result<Moment, Violation> {
    let mut observation = vec![0.0; simulator.spec().observation_size];
    let mut terms = vec![0.0; simulator.spec().reward_terms.len()];
    let end = granted("step", simulator.step(action, &mut observation, &mut terms))?;
    Ok(Moment { observation, terms, end })
}

/// An action in the middle of the bounds.
pub(super) fn middle(spec: &SimulatorSpec) -> Vec<f32> {
    spec.action_low.iter().zip(&spec.action_high).map(|(low, high)| (low + high) / 2.0).collect()
}

/// An episode that ends, cut after the step that ends it, or a reason to skip. Full force in either direction, then
/// random forces are tried for 500 steps each.
pub(super) fn ending_episode(case: &Case) -> Result<(Episode, Trace), Finding> {
    let mut simulator = case.simulator()?;
    let spec = simulator.spec().clone();
    let steady = |action: &[f32]| vec![action.to_vec(); TRIED_STEPS];
    for seed in 0..3 {
        let random = Episode::random(&spec, seed, TRIED_STEPS);
        let actions = match seed {
            0 => steady(&spec.action_high),
            1 => steady(&spec.action_low),
            _ => random.actions.clone(),
        };
        let mut episode = Episode { actions, ..random };
        let trace = episode.play(simulator.as_mut())?;
        if trace.moments.last().is_some_and(|last| last.end != End::Running) {
            episode.actions.truncate(trace.moments.len());
            return Ok((episode, trace));
        }
    }
    Err(Finding::Skipped(format!("none of three episodes of {TRIED_STEPS} steps ended")))
}

const TRIED_STEPS: usize = 500;
