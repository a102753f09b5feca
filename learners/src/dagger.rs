//! Closed-loop options by dataset aggregation (DAgger: Ross, Gordon and Bagnell 2011): a clone is tried, the teacher says what
//! it would have done in the states that the clone came to, and the clone is fitted again to all that is known.
//!
//! A clone of a recording alone has never seen where its own small errors lead (`docs/results/drift.md`).

use elo_core::fault::Faults;
use elo_core::policy::{Apprentice, Demonstration, OptionLearner, OptionPolicy, Tutor, Way};
use elo_core::seed::Seed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::behavior_cloning::BehaviorCloningConfig;
use crate::demonstration;
use crate::fields::refuse_faults;
use crate::mlp_policy::MlpPolicy;

/// Options that do what the teacher would do where they themselves come to: clones of a recording that are tried from starts of
/// `d0` in the teacher's task, corrected by the teacher's mean action and fitted again, several times (Ross et al. 2011). They
/// last as many steps as the recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DaggerConfig {
    /// How often the clone is tried and fitted again, after a first fit to the recording alone.
    #[schemars(range(min = 1, max = 1000))]
    pub rounds: u64,
    /// Rollouts of `discover.steps` in each round.
    #[schemars(range(min = 1, max = 1000))]
    pub rollouts: u64,
    /// How a clone is fitted. There are more steps to fit than `behavior_cloning` has, so fewer passes are needed.
    pub cloning: BehaviorCloningConfig,
}

impl Default for DaggerConfig {
    fn default() -> Self {
        let cloning = BehaviorCloningConfig { epochs: 100, ..BehaviorCloningConfig::default() };
        Self { rounds: 5, rollouts: 5, cloning }
    }
}

#[typetag::serde(name = "dagger")]
impl OptionLearner for DaggerConfig {
    fn validate(&self, faults: &mut Faults) {
        for (field, count) in [("rounds", self.rounds), ("rollouts", self.rollouts)] {
            faults.check((1..=1000).contains(&count), field, || format!("expected 1 to 1000, got {count}"));
        }
        faults.within("cloning", |faults| self.cloning.validate(faults));
    }

    fn way(&self) -> Way<'_> {
        Way::Apprentices(self)
    }
}

impl Apprentice for DaggerConfig {
    fn corrections(&self) -> u64 {
        self.rounds * self.rollouts
    }

    fn learn(
        &self,
        demonstration: &Demonstration,
        tutor: &mut dyn Tutor,
        seed: &Seed,
    ) -> Result<Box<dyn OptionPolicy>, String> {
        demonstration::check(demonstration, tutor.spec(), MlpPolicy::MAX_HORIZON)?;
        refuse_faults(|faults| self.validate(faults))?;
        let mut known = demonstration.clone();
        let mut option = self.clone_of(&known, demonstration.steps, &seed.child("fit").index(0))?;
        for round in 1..=self.rounds {
            for rollout in 0..self.rollouts {
                let seed = seed.child("rollout").index(round).index(rollout);
                let Demonstration { observations, actions, steps } = tutor.correct(&option, &seed)?;
                known.observations.extend(observations);
                known.actions.extend(actions);
                known.steps += steps;
            }
            option = self.clone_of(&known, demonstration.steps, &seed.child("fit").index(round))?;
        }
        Ok(Box::new(option))
    }
}

impl DaggerConfig {
    /// What was done in all `known` states, for `steps` control steps.
    fn clone_of(&self, known: &Demonstration, steps: usize, seed: &Seed) -> Result<MlpPolicy, String> {
        Ok(MlpPolicy::new(self.cloning.network(known, seed)?, steps))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;
    use elo_core::spec::SimulatorSpec;

    use super::*;

    /// A body that the recording shows at 0.2 alone. What a clone does moves it: its next place is what it did. The teacher does
    /// the opposite of where the body is.
    struct Seesaw {
        spec: SimulatorSpec,
        met: Vec<f32>,
    }

    fn seen(place: f32) -> [f32; 2] {
        [place, 0.0]
    }

    fn answer(option: &dyn OptionPolicy, place: f32) -> f32 {
        let mut action = [0.0];
        option.act(&seen(place), 0, &mut Seed::root(0).stream(), &mut action);
        action[0]
    }

    impl Tutor for Seesaw {
        fn spec(&self) -> &SimulatorSpec {
            &self.spec
        }

        fn correct(&mut self, option: &dyn OptionPolicy, _: &Seed) -> Result<Demonstration, String> {
            let mut places = vec![0.2];
            for _ in 1..10 {
                places.push(answer(option, *places.last().unwrap()).clamp(-1.0, 1.0));
            }
            self.met.extend(&places);
            Ok(Demonstration {
                observations: places.iter().copied().flat_map(seen).collect(),
                actions: places.iter().map(|place| -place).collect(),
                steps: places.len(),
            })
        }
    }

    fn errors(config: &DaggerConfig) -> (f32, Vec<f32>) {
        let recording = Demonstration { observations: seen(0.2).repeat(5), actions: vec![-0.2; 5], steps: 5 };
        let mut tutor = Seesaw { spec: PointMassConfig::default().description(), met: Vec::new() };
        let option = config.learn(&recording, &mut tutor, &Seed::root(1)).unwrap();
        let error = |place: f32| (answer(option.as_ref(), place) + place).abs();
        assert_eq!(option.termination(&[], 4), 0.0);
        assert_eq!(option.termination(&[], 5), 1.0);
        (error(0.2).max(error(-0.2)), tutor.met)
    }

    #[test]
    fn corrections_teach_what_the_recording_does_not_show() {
        let cloning = BehaviorCloningConfig { observation_noise: 0.0, ..DaggerConfig::default().cloning };
        let config = DaggerConfig { cloning, ..DaggerConfig::default() };
        let (error, met) = errors(&config);
        // All that the recording shows is 0.2, so a clone of it may answer anything at −0.2.
        assert!(error < 0.05, "{error}");
        assert_eq!(met.len(), 250);
    }

    /// A tutor whose corrections are of one place a round, another one each time.
    struct Wanderer {
        spec: SimulatorSpec,
        round: usize,
    }

    const PLACES: [f32; 4] = [-0.8, 0.8, -0.4, 0.4];

    impl Tutor for Wanderer {
        fn spec(&self) -> &SimulatorSpec {
            &self.spec
        }

        fn correct(&mut self, _: &dyn OptionPolicy, _: &Seed) -> Result<Demonstration, String> {
            let place = PLACES[self.round];
            self.round += 1;
            // Answers that no line through one of the places gives at the others.
            Ok(Demonstration {
                observations: seen(place).repeat(20),
                actions: vec![place.abs(); 20],
                steps: 20,
            })
        }
    }

    #[test]
    fn what_earlier_rounds_taught_is_not_forgotten() {
        let cloning =
            BehaviorCloningConfig { observation_noise: 0.0, epochs: 300, ..DaggerConfig::default().cloning };
        let config = DaggerConfig { rounds: 4, rollouts: 1, cloning };
        let recording =
            Demonstration { observations: seen(0.0).repeat(20), actions: vec![0.0; 20], steps: 20 };
        let mut tutor = Wanderer { spec: PointMassConfig::default().description(), round: 0 };
        let option = config.learn(&recording, &mut tutor, &Seed::root(1)).unwrap();
        for place in PLACES.into_iter().chain([0.0]) {
            let error = (answer(option.as_ref(), place) - place.abs()).abs();
            assert!(error < 0.1, "{error} at {place}");
        }
    }

    #[test]
    fn each_round_tries_the_clone_that_was_corrected() {
        let (_, met) = errors(&DaggerConfig { rounds: 3, rollouts: 1, ..DaggerConfig::default() });
        let rounds: Vec<&[f32]> = met.chunks(10).collect();
        assert!(rounds[0] != rounds[1] && rounds[1] != rounds[2], "{rounds:?}");
    }

    #[test]
    fn faults_name_the_field_within() {
        let mut config = DaggerConfig { rounds: 0, ..DaggerConfig::default() };
        config.cloning.epochs = 0;
        let mut faults = Faults::new();
        config.validate(&mut faults);
        let text: Vec<String> = faults.found().iter().map(ToString::to_string).collect();
        assert_eq!(text.len(), 2);
        assert!(text[0].contains("rounds") && text[1].contains("cloning.epochs"), "{text:?}");
    }
}
