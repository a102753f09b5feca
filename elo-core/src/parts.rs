//! What each option of a set that was learned as a whole does in it: how often it is drawn, and how long it lasts.

use serde::{Deserialize, Serialize};

use crate::crew::RunError;
use crate::discover::{Candidate, ContextSet, Run};
use crate::performer::Performer;
use crate::policy::OptionPolicy;
use crate::units::trace::Traced;

/// One option's part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OptionPart {
    /// Mean of `π_I(o|s)` (Eq. 6.3) over the states that the infant agent comes through: how often it would be drawn there. All
    /// shares add to 1.
    pub share: f64,
    /// Control steps that it lasts where it is drawn, `1/β_o(s)` on average; at most those of the horizon.
    pub steps: f64,
}

impl Run<'_> {
    /// The part of each option of a candidate that is a whole set, by what the infant agent with it sees in the first
    /// [`CONTEXTS_PER_UNIT`](crate::discover::CONTEXTS_PER_UNIT) of `contexts`. Empty where no worker could be kept alive for that.
    ///
    /// # Errors
    /// See [`RunError`].
    pub(crate) fn parts(
        &self,
        candidate: &Candidate,
        contexts: &ContextSet,
    ) -> Result<Vec<OptionPart>, RunError> {
        let Traced::Rollouts(seen) = self.observations(&[Performer::candidate(candidate)], contexts)? else {
            return Ok(Vec::new());
        };
        let options = self
            .options(candidate)?
            .iter()
            .map(|record| record.policy(&self.spec, &self.crew.staff.formats))
            .collect::<Result<Vec<_>, _>>()
            .map_err(|error| RunError::Config(error.to_string()))?;
        let longest = self.experiment.discover.steps as f64;
        Ok(parts(&options, seen.concat().chunks_exact(self.spec.observation_size), longest))
    }
}

fn parts<'a>(
    options: &[Box<dyn OptionPolicy>],
    states: impl ExactSizeIterator<Item = &'a [f32]>,
    longest: f64,
) -> Vec<OptionPart> {
    let count = states.len() as f64;
    let mut parts = vec![OptionPart { share: 0.0, steps: 0.0 }; options.len()];
    for state in states {
        let interests: Vec<f64> = options.iter().map(|option| f64::from(option.interest(state))).collect();
        let all: f64 = interests.iter().sum();
        for ((part, option), interest) in parts.iter_mut().zip(options).zip(interests) {
            let share = interest / all / count;
            part.share += share;
            part.steps += share * (1.0 / option.termination(state, 1)).min(longest);
        }
    }
    // An option whose share is too small for a number lasts as long as it may.
    for OptionPart { share, steps } in &mut parts {
        *steps = if *share > 0.0 { *steps / *share } else { longest };
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::PolicyRecord;
    use crate::seed::Stream;

    /// Interested where the state is above 0 by `above`, else by 1; ends with probability `ending`.
    #[derive(Debug)]
    struct Choosy {
        above: f32,
        ending: f64,
    }

    impl OptionPolicy for Choosy {
        fn interest(&self, observation: &[f32]) -> f32 {
            if observation[0] > 0.0 { self.above } else { 1.0 }
        }
        fn act(&self, _: &[f32], _: usize, _: &mut Stream, action: &mut [f32]) {
            action.fill(0.0);
        }
        fn termination(&self, _: &[f32], _: usize) -> f64 {
            self.ending
        }
        fn record(&self) -> PolicyRecord {
            unreachable!("it is never stored")
        }
    }

    #[test]
    fn shares_are_means_over_states_and_durations_those_where_an_option_is_drawn() {
        let options: Vec<Box<dyn OptionPolicy>> =
            vec![Box::new(Choosy { above: 3.0, ending: 0.25 }), Box::new(Choosy { above: 1.0, ending: 0.0 })];
        // Above 0 the shares are 3/4 and 1/4, elsewhere a half each; one state in four lies above.
        let found = parts(&options, [1.0_f32, -1.0, -1.0, -1.0].chunks_exact(1), 200.0);
        let expected = [(0.5625, 4.0), (0.4375, 200.0)];
        for (part, (share, steps)) in found.iter().zip(expected) {
            assert!((part.share - share).abs() < 1e-12 && (part.steps - steps).abs() < 1e-9, "{found:?}");
        }
    }
}
