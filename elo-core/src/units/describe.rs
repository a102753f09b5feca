//! Asks a worker what a simulator is, for those that only their worker knows. Its result is never stored.

use serde::{Deserialize, Serialize};

use super::{Work, WorkError};
use crate::simulator::SimulatorConfig;

/// One simulator to be described.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Describe {
    /// Which.
    pub simulator: Box<dyn SimulatorConfig>,
}

impl Describe {
    pub(super) fn perform(&self) -> Result<Vec<u8>, WorkError> {
        Ok(self.simulator.describe()?)
    }
}

impl From<Describe> for Work {
    fn from(work: Describe) -> Self {
        Self::Describe(work)
    }
}
