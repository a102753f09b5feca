//! Who asks metrics for scores: here, or by units of work for metrics whose code runs in a worker.

use crate::crew::{RunError, Unit};
use crate::discover::Run;
use crate::policy::Unwatched;
use crate::units::score::{self, Score};

/// Asks a metric wherever its code runs.
pub trait Judge {
    /// The scores of the samples, then those of each resample, as [`Score::scores`] gives them.
    ///
    /// # Errors
    /// The metric's, or what keeps its worker from running.
    fn scores(&self, score: Score, samples: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, RunError>;
}

/// For metrics whose code is in this program.
#[derive(Clone, Copy, Debug, Default)]
pub struct Here;

impl Judge for Here {
    fn scores(&self, score: Score, samples: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, RunError> {
        let scores = score.scores(samples, &mut Unwatched);
        scores.map_err(|error| RunError::Select(format!("{}: {error}", score.metric.label())))
    }
}

impl Judge for Run<'_> {
    fn scores(&self, score: Score, samples: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, RunError> {
        if score.metric.hosted().is_none() {
            return Here.scores(score, samples);
        }
        let stage = format!("scores by {}", score.metric.label());
        let inputs = vec![self.crew.import(&score::encode(samples))?];
        let keys = self.crew.complete(&stage, &[Unit { work: score.into(), inputs }])?;
        Ok(score::decode(&self.crew.result(&keys[0])?)?)
    }
}
