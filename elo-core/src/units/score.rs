//! Scores samples of returns by a metric, and resamples of them for intervals.
//!
//! Metrics whose code is in this program are asked where they are needed. Those of worker programs make units of this
//! stage.

use rand::RngExt as _;
use serde::{Deserialize, Serialize};

use super::codec::{self, Malformed};
use super::{Work, WorkError, input};
use crate::metric::{Metric, Reference};
use crate::policy::Monitor;
use crate::seed::Seed;

/// Resamples that a metric sees in one call.
const DRAWS_PER_CALL: usize = 100;

/// Scores of some samples, which are the one input (see [`encode`]) and of one size.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Score {
    /// By what.
    pub metric: Box<dyn Metric>,
    /// `(μ*, σ*)`.
    pub reference: Reference,
    /// How many resamples are scored besides the samples themselves. One resample draws the same places of all samples.
    pub draws: usize,
    /// The root of the resamples' stream.
    pub seed: Seed,
}

impl Score {
    pub(super) fn perform(
        &self,
        inputs: &[Vec<u8>],
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        Ok(encode(&self.scores(&decode(input(inputs, 0)?)?, monitor)?))
    }

    /// The scores of the samples, then those of each resample.
    ///
    /// # Errors
    /// The metric's, or an interruption.
    pub fn scores(
        &self,
        samples: &[Vec<f64>],
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<Vec<f64>>, WorkError> {
        let mut scores = Vec::with_capacity(1 + self.draws);
        for resamples in self.resamples(samples).chunks(DRAWS_PER_CALL) {
            monitor.progress(scores.len() as u64, 1 + self.draws as u64)?;
            scores.extend(self.call(resamples, samples).map_err(WorkError::Failed)?);
        }
        Ok(scores)
    }

    /// Places of each resample; the first is the samples themselves.
    fn resamples(&self, samples: &[Vec<f64>]) -> Vec<Vec<usize>> {
        let places = samples.first().map_or(0, Vec::len);
        let mut stream = self.seed.stream();
        let mut draw = |_| (0..places).map(|_| stream.random_range(0..places)).collect();
        std::iter::once((0..places).collect()).chain((0..self.draws).map(&mut draw)).collect()
    }

    fn call(&self, resamples: &[Vec<usize>], samples: &[Vec<f64>]) -> Result<Vec<Vec<f64>>, String> {
        let drawn = |places: &Vec<usize>, row: &Vec<f64>| places.iter().map(|place| row[*place]).collect();
        let rows: Vec<Vec<f64>> =
            resamples.iter().flat_map(|places| samples.iter().map(|row| drawn(places, row))).collect();
        let scores = self.metric.scores(&rows, &self.reference)?;
        if scores.len() == rows.len() {
            Ok(scores.chunks(samples.len().max(1)).map(<[f64]>::to_vec).collect())
        } else {
            Err(format!("{}: {} scores of {} samples", self.metric.label(), scores.len(), rows.len()))
        }
    }
}

/// Rows of numbers as bytes.
pub fn encode(rows: &[Vec<f64>]) -> Vec<u8> {
    codec::encode_rows(rows, codec::f64_bytes)
}

/// Reads rows of numbers.
///
/// # Errors
/// [`Malformed`].
pub fn decode(bytes: &[u8]) -> Result<Vec<Vec<f64>>, Malformed> {
    codec::decode_rows(bytes, codec::f64_numbers)
}

impl From<Score> for Work {
    fn from(work: Score) -> Self {
        Self::Score(work)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::metric::MaximumMean;
    use crate::policy::Unwatched;

    #[test]
    fn resamples_draw_the_same_places_of_all_samples_here_and_in_a_unit() {
        let score = Score {
            metric: Box::new(MaximumMean {}),
            reference: Reference { mean: 0.0, standard_deviation: 0.0 },
            draws: 250,
            seed: Seed::root(3),
        };
        let samples = vec![vec![1.0, 2.0, 4.0], vec![11.0, 12.0, 14.0]];
        let scores = score.scores(&samples, &mut Unwatched).unwrap();
        assert_eq!((scores.len(), scores[0][0], scores[0][1]), (251, 7.0 / 3.0, 37.0 / 3.0));
        assert!(scores.iter().all(|pair| (pair[1] - pair[0] - 10.0).abs() < 1e-12));
        assert!(scores.iter().any(|pair| pair[0] != scores[0][0]));
        let unit = score.perform(&[encode(&samples)], &mut Unwatched).unwrap();
        assert_eq!(decode(&unit).unwrap(), scores);
        assert!(decode(&unit[..unit.len() - 3]).is_err());
    }
}
