//! Contexts of one split: a task each, and a start that is reached once.

use serde::{Deserialize, Serialize};

use super::arena::Arena;
use super::codec::{self, Malformed};
use super::{Site, Span, Work, WorkError};
use crate::context::{Context, InitialStates};
use crate::policy::Monitor;
use crate::seed::{Seed, Stream};
use crate::simulator::SimulatorConfig;
use crate::task::{Task, TaskDistribution};
use rand::RngExt as _;

/// Some contexts of one split.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prepare {
    /// The world that the starts are reached in.
    pub simulator: Box<dyn SimulatorConfig>,
    /// Where the tasks come from.
    pub tasks: TaskSource,
    /// `d0`.
    pub initial_states: InitialStates,
    /// Which contexts.
    pub span: Span,
    /// The root of the split's streams; context `j` draws from its child `j` alone.
    pub seed: Seed,
}

/// Where contexts take their tasks from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TaskSource {
    /// Anew from `P`.
    Distribution(TaskDistribution),
    /// Uniformly from these.
    Uniformly(Vec<Task>),
}

impl TaskSource {
    /// Draws one task, and its number where they are numbered.
    pub fn draw(&self, stream: &mut Stream) -> (Task, Option<usize>) {
        match self {
            Self::Distribution(distribution) => (distribution.draw(stream), None),
            Self::Uniformly(tasks) => {
                let index = stream.random_range(0..tasks.len());
                (tasks[index].clone(), Some(index))
            }
        }
    }
}

impl Prepare {
    pub(super) fn perform(&self, site: &mut Site, monitor: &mut dyn Monitor) -> Result<Vec<u8>, WorkError> {
        let mut arena = Arena::new(site, self.simulator.as_ref());
        let mut contexts = Vec::with_capacity(self.span.count);
        for (j, seed) in self.span.seeds(&self.seed) {
            monitor.progress(contexts.len() as u64, self.span.count as u64)?;
            let (task, _) = self.tasks.draw(&mut seed.child("task").stream());
            let start =
                arena.start(&self.initial_states, &task, &seed.child("start")).map_err(
                    |error| match error {
                        WorkError::Failed(why) => WorkError::Failed(format!("context {j}: {why}")),
                        other => other,
                    },
                )?;
            contexts.push(Context { task, start });
        }
        Ok(encode(&contexts))
    }
}

/// The bytes of contexts.
pub fn encode(contexts: &[Context]) -> Vec<u8> {
    codec::encode(&contexts, &[])
}

/// Reads a unit's result: its contexts in order.
///
/// # Errors
/// [`Malformed`].
pub fn decode(bytes: &[u8]) -> Result<Vec<Context>, Malformed> {
    codec::decode(bytes).map(|(contexts, _)| contexts)
}

impl From<Prepare> for Work {
    fn from(work: Prepare) -> Self {
        Self::Prepare(work)
    }
}
