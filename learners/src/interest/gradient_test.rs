//! The gradients that training takes its steps along, Gaussian policies, scaling and minibatches included, against finite
//! differences of an objective that is computed exactly.

#![allow(clippy::unwrap_used)]

use elo_core::context::InitialStates;
use elo_core::task::{Range, TaskDistribution};

use super::advantages::Advantages;
use super::batch::Batch;
use super::config::{Discounts, InterestConfig, LearningRates};
use super::drawing;
use super::duration::{Band, Termination};
use super::learner::Learner;
use super::train::{Signals, Training};
use super::worlds::{World, practice};
use crate::nn::reference;

/// Far from 1, so that a factor that is missing shows.
const GAMMA: f64 = 0.7;

/// Two options in two states; the last network parameter is a bias.
fn config() -> InterestConfig {
    InterestConfig {
        continuations: Band { low: 3.0, high: 4.0 },
        duration_weight: 0.01,
        initial_continuations: 2.0,
        steps: 40_000,
        rollout_steps: 40_000,
        context_pool: 1000,
        learning_rates: LearningRates::default(),
        discount: Discounts { gamma: GAMMA, gae_lambda: 1.0 },
        discounted_visits: true,
        hidden: Vec::new(),
        initial_log_std: -0.3,
        ..InterestConfig::default()
    }
}

/// `θ` in a row: each option's policy network, its log standard deviation, each option's interest network, the logit.
fn flat(learner: &Learner) -> Vec<f64> {
    let policies = learner.policies.iter().flat_map(|p| [p.means.network.params(), &p.log_std].concat());
    let interests = learner.interests.iter().flat_map(|net| net.network.params().to_vec());
    policies.chain(interests).map(f64::from).chain([learner.termination.logit]).collect()
}

/// `Φ`, by integrating the density from 0 with Simpson's rule.
fn normal_cdf(x: f64) -> f64 {
    let density = |t: f64| (-0.5 * t * t).exp() / std::f64::consts::TAU.sqrt();
    let h = x / 200.0;
    let weight = |i: u32| if i == 0 || i == 200 { 1.0 } else { 2.0 + 2.0 * f64::from(i % 2) };
    0.5 + h / 3.0 * (0..=200).map(|i| weight(i) * density(f64::from(i) * h)).sum::<f64>()
}

/// `J(θ)` in the world with the hot surface, from state 0, for tasks that pay 1 on average: values are linear in the pay.
/// `Q` is the fixed point of Eq. 6.4 and 6.5.
fn objective(theta: &[f64]) -> f64 {
    let forward = |s: usize, o: usize| {
        let of = &theta[4 * o..4 * o + 4];
        normal_cdf((of[s] + of[2]) / of[3].exp())
    };
    let drawing = |s: usize| {
        let z = [8, 11].map(|start| theta[start + s] + theta[start + 2]);
        let mut probabilities = [0.0; 2];
        drawing::probabilities(&z, &mut probabilities);
        probabilities
    };
    let termination = Termination { logit: theta[14] };
    let ending = termination.probability();
    let mut q = [[0.0_f64; 2]; 2];
    for _ in 0..400 {
        let v = [0, 1].map(|s| drawing::state_value(&drawing(s), &q[s]));
        let u = |s: usize, o: usize| (1.0 - ending) * q[s][o] + ending * v[s];
        let backup = |s: usize, o: usize| {
            let f = forward(s, o);
            match s {
                0 => f * (1.0 + GAMMA * (0.7 * u(0, o) + 0.3 * u(1, o))) + (1.0 - f) * GAMMA * u(0, o),
                _ => f * (GAMMA * u(1, o) - 1.0) + (1.0 - f) * (1.0 + GAMMA * u(0, o)),
            }
        };
        q = [0, 1].map(|s| [0, 1].map(|o| backup(s, o)));
    }
    let InterestConfig { continuations, duration_weight, .. } = config();
    drawing::state_value(&drawing(0), &q[0]) - duration_weight * continuations.cost(termination)
}

/// One iteration's estimate of `∇J`, in the layout of [`flat`], from the gradients that the networks are left with.
fn estimate(training: &mut Training<'_>, iteration: u64) -> Vec<f64> {
    training.record.iteration = iteration;
    let mut experience = training.collect().unwrap();
    training.estimate_advantages(&mut experience);
    let weights = training.weights(&experience);
    let signals = Signals::new(&experience, &weights);
    let rows: Vec<usize> = (0..experience.steps.len()).collect();
    let config = config();
    let batch = Batch { config: &config, experience: &experience, signals: &signals, rows: &rows };
    batch.differentiate(&mut training.learner);

    // Losses are means over steps, of advantages with deviation 1; `J` is a sum over the steps of a rollout.
    let deviation = |of: &dyn Fn(&Advantages) -> f64, wanted: &dyn Fn(usize) -> bool| {
        let values: Vec<f64> =
            rows.iter().filter(|&&row| wanted(row)).map(|&row| of(&experience.advantages[row])).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    };
    let visits = experience.discounts.iter().sum::<f64>() / experience.ends.len() as f64;
    let of_actions = -visits * deviation(&|a| a.action, &|_| true);
    let of_draws = -visits * deviation(&|a| a.draw, &|row| experience.steps[row].drawn);
    let learner = &training.learner;
    let policies =
        learner.policies.iter().flat_map(|p| [&p.means.gradient[..], &p.log_std_gradient].concat());
    let interests = learner.interests.iter().flat_map(|net| net.gradient.clone());
    let worth = training.worth_of_ending(&experience, &weights);
    let end = training.termination_gradient(learner.termination, worth);
    let scaled = |scale: f64| move |d: f32| scale * f64::from(d);
    policies.map(scaled(of_actions)).chain(interests.map(scaled(of_draws))).chain([end]).collect()
}

#[test]
fn the_gradient_of_training_has_the_exact_one_as_its_mean() {
    let config = config();
    let tasks = TaskDistribution::new([("pay", Range { low: 0.5, high: 1.5 })]);
    let initial_states = InitialStates { max_random_steps: 0, ..InitialStates::default() };
    let practice = practice(&World::Hot, &tasks, &initial_states, 40, 1);
    let mut training = Training::new(&config, &practice).unwrap();
    let learner = &mut training.learner;
    learner.policies[0].means.network.params_mut().copy_from_slice(&[0.9, -0.6, 0.1]);
    learner.policies[1].means.network.params_mut().copy_from_slice(&[-0.8, 0.5, -0.1]);
    learner.interests[0].network.params_mut().copy_from_slice(&[0.8, -0.7, 0.1]);
    learner.interests[1].network.params_mut().copy_from_slice(&[-0.6, 0.9, 0.0]);

    let expected = {
        let point = flat(&training.learner);
        reference::differences(&point, &(0..point.len()).collect::<Vec<_>>(), objective)
    };
    // Each from a new training, whose normaliser changes nothing yet.
    let estimates: Vec<Vec<f64>> = (0..40)
        .map(|iteration| {
            let mut afresh = Training::new(&config, &practice).unwrap();
            afresh.learner = training.learner.clone();
            estimate(&mut afresh, iteration)
        })
        .collect();
    let n = estimates.len() as f64;
    let (mut noise, mut signal) = (0.0, 0.0);
    for (index, expected) in expected.iter().enumerate() {
        let mean = estimates.iter().map(|estimate| estimate[index]).sum::<f64>() / n;
        let squares = estimates.iter().map(|estimate| (estimate[index] - mean).powi(2)).sum::<f64>();
        let error = (squares / (n - 1.0) / n).sqrt();
        assert!(
            (mean - expected).abs() < 4.0 * error,
            "number {index}: {mean} ± {error}, exactly {expected}"
        );
        noise += error * error;
        signal += expected * expected;
    }
    let share = (noise / signal).sqrt();
    assert!(share < 0.05, "standard errors of {share} of the gradient show nothing");
}
