//! Algorithm 1(a), the loop's last line: define an option that reproduces the behaviour in `h_i`.

use serde::{Deserialize, Serialize};

use super::codec::{self, Malformed};
use super::{Span, Work, WorkError, input, record};
use crate::policy::{Monitor, OptionLearner, PolicyRecord, Way};
use crate::seed::Seed;
use crate::spec::SimulatorSpec;
use crate::tensors::Tensors;

/// Options for some candidates. The one input holds their recordings.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Learn {
    /// The option learner; one that imitates.
    pub learner: Box<dyn OptionLearner>,
    /// The description of the robot.
    pub spec: SimulatorSpec,
    /// Which candidates.
    pub span: Span,
    /// The root of the stage's streams; candidate `i` draws from its child `i` alone.
    pub seed: Seed,
}

impl Learn {
    pub(super) fn perform(
        &self,
        inputs: &[Vec<u8>],
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        let Way::Imitates(learner) = self.learner.way() else {
            return Err(WorkError::Failed(
                "this option learner does not learn from recordings alone".to_owned(),
            ));
        };
        let recordings = record::decode(input(inputs, 0)?)?;
        let mut options = Vec::with_capacity(recordings.len());
        for ((i, seed), recording) in self.span.seeds(&self.seed).zip(&recordings) {
            monitor.progress(options.len() as u64, self.span.count as u64)?;
            let option = recording.demonstration.as_ref().map(|demonstration| {
                let learned = learner.learn(demonstration, &self.spec, &seed);
                learned
                    .map(|option| option.record())
                    .map_err(|why| WorkError::Failed(format!("candidate {i}: {why}")))
            });
            options.push(option.transpose()?);
        }
        Ok(encode(&options))
    }
}

/// The bytes of a unit's result.
pub fn encode(options: &[Option<PolicyRecord>]) -> Vec<u8> {
    let formats: Vec<Option<&str>> = options.iter().map(|o| o.as_ref().map(|o| o.format.as_str())).collect();
    let sections: Vec<Vec<u8>> = options.iter().flatten().map(|option| option.tensors.encode()).collect();
    codec::encode(&formats, &sections.iter().map(Vec::as_slice).collect::<Vec<_>>())
}

/// Reads a unit's result: its options in order; `None` where there was no recording.
///
/// # Errors
/// [`Malformed`].
pub fn decode(bytes: &[u8]) -> Result<Vec<Option<PolicyRecord>>, Malformed> {
    let (formats, sections): (Vec<Option<String>>, _) = codec::decode(bytes)?;
    let mut sections = sections.into_iter();
    formats
        .into_iter()
        .map(|format| {
            let Some(format) = format else { return Ok(None) };
            let section = sections.next().ok_or_else(|| Malformed("an option is missing".to_owned()))?;
            let tensors = Tensors::decode(section).map_err(|error| Malformed(error.to_string()))?;
            Ok(Some(PolicyRecord { format, tensors }))
        })
        .collect()
}

impl From<Learn> for Work {
    fn from(work: Learn) -> Self {
        Self::Learn(work)
    }
}
