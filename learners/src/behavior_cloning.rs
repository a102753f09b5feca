//! Closed-loop options by behaviour cloning: a small network fitted to what the teacher did where.

use elo_core::fault::Faults;
use elo_core::policy::{Demonstration, Imitate, OptionLearner, OptionPolicy, Way};
use elo_core::seed::Seed;
use elo_core::spec::SimulatorSpec;
use rand::seq::SliceRandom as _;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::demonstration;
use crate::fields::{check_hidden, refuse_faults, widths};
use crate::kernels::running_moments::{Normalizer, RunningMoments};
use crate::kernels::value_loss::value_loss;
use crate::mlp_policy::MlpPolicy;
use crate::nn::{Adam, Mlp, fill_standard_normal};
use crate::normalized_mlp::NormalizedMlp;

/// Options that answer what the robot sees as the teacher answered it: a network fitted to the observation and action
/// pairs of the demonstration by least squares. It lasts as many steps as the demonstration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BehaviorCloningConfig {
    /// Widths of the hidden layers.
    pub hidden: Vec<usize>,
    /// Passes over the demonstration.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub epochs: usize,
    /// Steps of the demonstration whose mean error one gradient step descends.
    #[schemars(range(min = 1))]
    pub minibatch: usize,
    /// Adam's step size at the beginning, which falls linearly to zero; must be positive.
    pub learning_rate: f64,
    /// Standard deviation of the noise that is added to observations while fitting, in standard deviations of the
    /// demonstration's own. It teaches the network to answer alike near the demonstration, where its own small errors
    /// take the robot; much of it blurs what the teacher did.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub observation_noise: f64,
}

impl Default for BehaviorCloningConfig {
    fn default() -> Self {
        Self {
            hidden: vec![32, 32],
            epochs: 400,
            minibatch: 50,
            learning_rate: 1e-2,
            observation_noise: 0.05,
        }
    }
}

/// Components of the observation that vary less than this in the demonstration are not scaled up to unit variance: in
/// another episode they may vary more.
const LEAST_DEVIATION: f64 = 0.01;

#[typetag::serde(name = "behavior_cloning")]
impl OptionLearner for BehaviorCloningConfig {
    fn validate(&self, faults: &mut Faults) {
        check_hidden(faults, &self.hidden);
        faults.check((1..=1_000_000).contains(&self.epochs), "epochs", || {
            format!("expected 1 to 1000000, got {}", self.epochs)
        });
        faults.check(self.minibatch >= 1, "minibatch", || "expected at least 1, got 0".to_owned());
        let (rate, noise) = (self.learning_rate, self.observation_noise);
        faults.check(rate > 0.0 && rate.is_finite(), "learning_rate", || {
            format!("expected a positive number, got {rate}")
        });
        faults.check((0.0..=10.0).contains(&noise), "observation_noise", || {
            format!("expected 0 to 10, got {noise}")
        });
    }

    fn way(&self) -> Way<'_> {
        Way::Imitates(self)
    }
}

impl Imitate for BehaviorCloningConfig {
    fn learn(
        &self,
        demonstration: &Demonstration,
        spec: &SimulatorSpec,
        seed: &Seed,
    ) -> Result<Box<dyn OptionPolicy>, String> {
        demonstration::check(demonstration, spec, MlpPolicy::MAX_HORIZON)?;
        refuse_faults(|faults| self.validate(faults))?;
        Ok(Box::new(MlpPolicy::new(self.network(demonstration, seed)?, demonstration.steps)))
    }
}

impl BehaviorCloningConfig {
    /// A network that answers the observations of a demonstration, on their own scale, as it did.
    ///
    /// # Errors
    /// Numbers that stopped being finite.
    pub(crate) fn network(
        &self,
        demonstration: &Demonstration,
        seed: &Seed,
    ) -> Result<NormalizedMlp, String> {
        let inputs = demonstration.observations.len() / demonstration.steps;
        let normalizer = normalizer_of(std::slice::from_ref(demonstration), inputs);
        let network = self.fit(demonstration, &normalizer, seed)?;
        Ok(NormalizedMlp::new(normalizer, network))
    }

    /// A network that answers the normalised observations of a demonstration as it did.
    ///
    /// # Errors
    /// Numbers that stopped being finite.
    pub(crate) fn fit(
        &self,
        demonstration: &Demonstration,
        normalizer: &Normalizer,
        seed: &Seed,
    ) -> Result<Mlp, String> {
        let Demonstration { observations, actions, steps } = demonstration;
        let (inputs, outputs) = (observations.len() / steps, actions.len() / steps);
        let sizes = widths(inputs, &self.hidden, outputs);
        let mut network = Mlp::orthogonal(&sizes, 1.0, &mut seed.child("weights").stream())
            .map_err(|error| error.to_string())?;
        let mut optimiser = Adam::new(network.params().len());
        let mut activations = network.activations();
        let mut gradient = vec![0.0; network.params().len()];
        let mut normalized = vec![0.0; observations.len()];
        normalizer.apply(observations, &mut normalized);

        let (mut shuffler, mut noises) = (seed.child("order").stream(), seed.child("noise").stream());
        let mut order: Vec<usize> = (0..*steps).collect();
        let (mut targets, mut derivatives) = (Vec::new(), Vec::new());
        let mut noise = vec![0.0; inputs];
        let mut error = 0.0;
        for epoch in 0..self.epochs {
            let rate = self.learning_rate * (1.0 - epoch as f64 / self.epochs as f64);
            order.shuffle(&mut shuffler);
            error = 0.0;
            for rows in order.chunks(self.minibatch) {
                let input = activations.input_mut(rows.len());
                targets.clear();
                for (x, &row) in input.chunks_exact_mut(inputs).zip(rows) {
                    fill_standard_normal(&mut noises, &mut noise);
                    for ((x, seen), z) in x.iter_mut().zip(&normalized[row * inputs..]).zip(&noise) {
                        *x = seen + self.observation_noise as f32 * z;
                    }
                    targets.extend_from_slice(&actions[row * outputs..][..outputs]);
                }
                derivatives.resize(targets.len(), 0.0);
                let answers = network.forward_loaded(&mut activations);
                error += value_loss(answers, &targets, &mut derivatives) * rows.len() as f32 / *steps as f32;
                gradient.fill(0.0);
                network.backward(&mut activations, &derivatives, &mut gradient);
                optimiser.step(network.params_mut(), &gradient, rate);
            }
        }
        if !(error.is_finite() && network.params().iter().all(|p| p.is_finite())) {
            return Err(format!(
                "fitting the demonstration did not converge (error {error}): lower learning_rate"
            ));
        }
        Ok(network)
    }
}

/// The scale of what was seen in all of `demonstrations`, as one.
pub(crate) fn normalizer_of(demonstrations: &[Demonstration], inputs: usize) -> Normalizer {
    let mut moments = RunningMoments::new(inputs);
    demonstrations.iter().for_each(|demonstration| moments.update(&demonstration.observations));
    let scale = |variance: f64| {
        let deviation = variance.sqrt();
        if deviation < LEAST_DEVIATION { 1.0 } else { (1.0 / deviation) as f32 }
    };
    Normalizer {
        means: moments.means().iter().map(|&mean| mean as f32).collect(),
        scales: moments.variances().map(scale).collect(),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;

    use super::*;

    const STEPS: usize = 200;

    /// A body of 26 numbers that swing at different rates, and six answers that depend on four of them each, none of
    /// them linearly; one number never changes.
    fn demonstration() -> (Demonstration, SimulatorSpec) {
        let wave = |t: usize, i: usize| (0.05 * t as f32 * (1.0 + 0.31 * i as f32) + i as f32).sin();
        let seen = |t: usize| -> Vec<f32> {
            (0..26).map(|i| if i == 3 { 0.7 } else { 5.0 * i as f32 + wave(t, i) }).collect()
        };
        let done = |t: usize| -> Vec<f32> {
            (0..6).map(|j| (wave(t, j + 4) - wave(t, j + 9) * wave(t, j + 12)).tanh()).collect()
        };
        let demonstration = Demonstration {
            observations: (0..STEPS).flat_map(seen).collect(),
            actions: (0..STEPS).flat_map(done).collect(),
            steps: STEPS,
        };
        let mut spec = PointMassConfig::default().description();
        spec.observation_size = 26;
        (spec.action_low, spec.action_high) = (vec![-1.0; 6], vec![1.0; 6]);
        (demonstration, spec)
    }

    /// Root of the mean squared difference between the option's actions and the teacher's.
    fn error(option: &dyn OptionPolicy, demonstration: &Demonstration) -> f64 {
        let mut stream = Seed::root(0).stream();
        let mut squares = 0.0;
        let rows = demonstration.observations.chunks(26).zip(demonstration.actions.chunks(6));
        for (elapsed, (observation, expected)) in rows.enumerate() {
            let mut action = [0.0; 6];
            option.act(observation, elapsed, &mut stream, &mut action);
            squares += action.iter().zip(expected).map(|(a, e)| f64::from(a - e).powi(2)).sum::<f64>();
        }
        (squares / demonstration.actions.len() as f64).sqrt()
    }

    #[test]
    fn the_demonstration_is_reproduced() {
        let (demonstration, spec) = demonstration();
        let config = BehaviorCloningConfig::default();
        let option = config.learn(&demonstration, &spec, &Seed::root(1)).unwrap();
        let error = error(option.as_ref(), &demonstration);
        // The actions' own deviation is about 0.6.
        assert!(error < 0.05, "root mean squared error {error}");
        assert_eq!((option.termination(&[], STEPS - 1), option.termination(&[], STEPS)), (0.0, 1.0));
    }

    #[test]
    fn noise_makes_the_answers_smoother() {
        // How far the answers move when the observation is moved off the demonstration.
        let (demonstration, spec) = demonstration();
        let roughness = |observation_noise: f64| {
            let config = BehaviorCloningConfig { observation_noise, ..BehaviorCloningConfig::default() };
            let option = config.learn(&demonstration, &spec, &Seed::root(1)).unwrap();
            let mut shifted = demonstration.clone();
            let mut noise = vec![0.0; shifted.observations.len()];
            fill_standard_normal(&mut Seed::root(5).stream(), &mut noise);
            shifted.observations.iter_mut().zip(&noise).for_each(|(x, z)| *x += 0.2 * z);
            error(option.as_ref(), &shifted)
        };
        let (smooth, rough) = (roughness(0.3), roughness(0.0));
        assert!(smooth < 0.8 * rough, "{smooth} with noise, {rough} without");
    }

    #[test]
    fn the_same_seed_gives_the_same_option() {
        let (demonstration, spec) = demonstration();
        let config = BehaviorCloningConfig { epochs: 3, ..BehaviorCloningConfig::default() };
        let record = |seed| config.learn(&demonstration, &spec, &Seed::root(seed)).unwrap().record();
        assert_eq!(record(1), record(1));
        assert_ne!(record(1), record(2));
    }

    #[test]
    fn what_cannot_be_fitted_is_refused() {
        let (whole, spec) = demonstration();
        let config = BehaviorCloningConfig::default();
        let refused = |config: &BehaviorCloningConfig, demonstration: &Demonstration| {
            config.learn(demonstration, &spec, &Seed::root(1)).unwrap_err()
        };
        let cut = Demonstration { steps: STEPS - 1, ..whole.clone() };
        assert!(refused(&config, &cut).contains("199 rows of 26"), "{}", refused(&config, &cut));
        let wild = BehaviorCloningConfig { learning_rate: 1e30, ..config.clone() };
        assert!(refused(&wild, &whole).contains("did not converge"), "{}", refused(&wild, &whole));
        let mut faults = Faults::new();
        let wrong = BehaviorCloningConfig {
            hidden: vec![0],
            epochs: 0,
            minibatch: 0,
            learning_rate: f64::NAN,
            observation_noise: -1.0,
        };
        wrong.validate(&mut faults);
        assert_eq!(faults.found().len(), 5);
    }
}
