//! The other way to candidates: a whole set of options, learned together from rollouts of their own (§6.2).

use serde::{Deserialize, Serialize};

use super::attempts::attempt;
use super::codec::{self, Malformed};
use super::{Work, WorkError, learn, record};
use crate::context::InitialStates;
use crate::policy::{
    CurvePoint, Demonstration, Monitor, OptionLearner, PolicyRecord, Practice, TrainError, Way,
};
use crate::rollout::Horizon;
use crate::seed::Seed;
use crate::simulator::SimulatorConfig;
use crate::task::TaskDistribution;

/// One set. The one input, if there is one, holds the recordings that its options begin from.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Practise {
    /// The world that it practises in.
    pub simulator: Box<dyn SimulatorConfig>,
    /// The option learner; one that practises.
    pub learner: Box<dyn OptionLearner>,
    /// `P`.
    pub tasks: TaskDistribution,
    /// `d0`.
    pub initial_states: InitialStates,
    /// `K`.
    pub set_size: usize,
    /// Length, discount and end of its rollouts.
    pub horizon: Horizon,
    /// The root of its streams.
    pub seed: Seed,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct SetResult {
    /// The set; empty when every attempt diverged.
    pub options: Vec<PolicyRecord>,
    /// What was seen on the way.
    pub story: Story,
}

/// What was seen while a set was learned.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Story {
    /// Why each earlier attempt was given up.
    pub diverged: Vec<String>,
    /// What the infant agent earned on the way.
    pub curve: Vec<CurvePoint>,
}

impl Practise {
    pub(super) fn perform(
        &self,
        inputs: &[Vec<u8>],
        monitor: &mut dyn Monitor,
    ) -> Result<Vec<u8>, WorkError> {
        let Way::Practises(learner) = self.learner.way() else {
            return Err(WorkError::Failed("this option learner needs recordings to imitate".to_owned()));
        };
        let mut demonstrations: Vec<Demonstration> = Vec::new();
        for bytes in inputs {
            demonstrations.extend(record::decode(bytes)?.into_iter().filter_map(|r| r.demonstration));
        }
        let outcome = attempt(&self.seed, monitor, |seed, monitor| {
            let practice = Practice {
                simulator: self.simulator.as_ref(),
                tasks: &self.tasks,
                initial_states: &self.initial_states,
                set_size: self.set_size,
                horizon: self.horizon.clone(),
                demonstrations: &demonstrations,
                seed: seed.clone(),
            };
            let practised = learner.practise(&practice, monitor)?;
            match practised.options.len() {
                count if count == self.set_size => Ok(practised),
                count => {
                    Err(TrainError::Other(format!("a set of {count} options, not of {}", self.set_size)))
                }
            }
        })?;
        let (options, curve) = outcome.trained.map_or_else(Default::default, |p| (p.options, p.curve));
        let options = options.iter().map(|option| option.record()).collect();
        Ok(SetResult { options, story: Story { diverged: outcome.diverged, curve } }.encode())
    }
}

impl SetResult {
    /// The bytes of the result: those of [`learn::encode`] with one section more, so that whoever plays options reads both
    /// alike.
    pub fn encode(&self) -> Vec<u8> {
        let formats: Vec<Option<&str>> = self.options.iter().map(|o| Some(o.format.as_str())).collect();
        let mut sections: Vec<Vec<u8>> = self.options.iter().map(|option| option.tensors.encode()).collect();
        sections.push(serde_json::to_vec(&self.story).expect("words and finite numbers"));
        codec::encode(&formats, &sections.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    /// Reads a unit's result.
    ///
    /// # Errors
    /// [`Malformed`].
    pub fn decode(bytes: &[u8]) -> Result<Self, Malformed> {
        let options = learn::decode(bytes)?.into_iter().flatten().collect();
        let (_, sections): (serde::de::IgnoredAny, _) = codec::decode(bytes)?;
        let story = sections.last().copied().unwrap_or_default();
        let story = serde_json::from_slice(story).map_err(|error| Malformed(error.to_string()))?;
        Ok(Self { options, story })
    }
}

impl From<Practise> for Work {
    fn from(work: Practise) -> Self {
        Self::Practise(work)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::tensors::Tensors;

    #[test]
    fn a_set_reads_back_whole_and_as_options() {
        let mut tensors = Tensors::new();
        tensors.insert("weights", &[2], vec![0.5, -0.5]);
        let option = PolicyRecord { format: "push".to_owned(), tensors };
        let point = CurvePoint { steps: 10, mean_return: Some(1.5), mean_length: None };
        let story = Story { diverged: vec!["after 3 steps: NaN".to_owned()], curve: vec![point] };
        for options in [vec![option.clone(), option.clone()], Vec::new()] {
            let set = SetResult { options: options.clone(), story: story.clone() };
            let bytes = set.encode();
            assert_eq!(SetResult::decode(&bytes).unwrap(), set);
            let as_options: Vec<_> = options.into_iter().map(Some).collect();
            assert_eq!(learn::decode(&bytes).unwrap(), as_options);
            assert!(SetResult::decode(&bytes[..bytes.len() - 1]).is_err());
        }
    }
}
