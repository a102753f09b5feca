//! Asks a worker what a plugin is, for those that only their worker knows. Its result is never stored.

use serde::{Deserialize, Serialize};

use super::{Work, WorkError};
use crate::hosted::Hosted;
use crate::metric::Metric;
use crate::policy::TeacherConfig;
use crate::simulator::SimulatorConfig;

/// A plugin to be described.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Describe {
    /// A simulator.
    Simulator(Box<dyn SimulatorConfig>),
    /// What makes teachers.
    Teacher(Box<dyn TeacherConfig>),
    /// A metric.
    Metric(Box<dyn Metric>),
}

impl Describe {
    /// The plugin, if its code runs elsewhere.
    pub fn hosted(&self) -> Option<&dyn Hosted> {
        match self {
            Self::Simulator(simulator) => simulator.hosted(),
            Self::Teacher(teacher) => teacher.hosted(),
            Self::Metric(metric) => metric.hosted(),
        }
    }

    pub(super) fn perform(&self) -> Result<Vec<u8>, WorkError> {
        Ok(self.hosted().map_or(Ok(Vec::new()), Hosted::describe)?)
    }
}

impl From<Describe> for Work {
    fn from(work: Describe) -> Self {
        Self::Describe(work)
    }
}
