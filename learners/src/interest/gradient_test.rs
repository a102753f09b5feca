//! The gradients that training takes its steps along, Gaussian policies, scaling and minibatches included, against finite
//! differences of an objective that is computed exactly; that of the critic against differences of its loss.

#![allow(clippy::unwrap_used)]

use elo_core::context::InitialStates;
use elo_core::policy::Unwatched;
use elo_core::task::{Range, TaskDistribution};

use super::advantages::Advantages;
use super::batch::Batch;
use super::config::{Discounts, InterestConfig, LearningRates};
use super::drawing;
use super::duration::{Band, Termination};
use super::learner::Learner;
use super::practice::{Experience, LastState};
use super::risk::{self, Risk};
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

/// The chance that `option` goes on in `state`.
fn forward(theta: &[f64], state: usize, option: usize) -> f64 {
    let of = &theta[4 * option..4 * option + 4];
    normal_cdf((of[state] + of[2]) / of[3].exp())
}

/// `π_I(·|state)`.
fn drawing_in(theta: &[f64], state: usize) -> [f64; 2] {
    let z = [8, 11].map(|start| theta[start + state] + theta[start + 2]);
    let mut probabilities = [0.0; 2];
    drawing::probabilities(&z, &mut probabilities);
    probabilities
}

/// `J(θ)` in the world with the hot surface, from state 0, for tasks that pay 1 on average: values are linear in the pay.
/// `Q` is the fixed point of Eq. 6.4 and 6.5.
fn objective(theta: &[f64]) -> f64 {
    let termination = Termination { logit: theta[14] };
    let ending = termination.probability();
    let mut q = [[0.0_f64; 2]; 2];
    for _ in 0..400 {
        let v = [0, 1].map(|s| drawing::state_value(&drawing_in(theta, s), &q[s]));
        let u = |s: usize, o: usize| (1.0 - ending) * q[s][o] + ending * v[s];
        let backup = |s: usize, o: usize| {
            let f = forward(theta, s, o);
            match s {
                0 => f * (1.0 + GAMMA * (0.7 * u(0, o) + 0.3 * u(1, o))) + (1.0 - f) * GAMMA * u(0, o),
                _ => f * (GAMMA * u(1, o) - 1.0) + (1.0 - f) * (1.0 + GAMMA * u(0, o)),
            }
        };
        q = [0, 1].map(|s| [0, 1].map(|o| backup(s, o)));
    }
    let InterestConfig { continuations, duration_weight, .. } = config();
    drawing::state_value(&drawing_in(theta, 0), &q[0]) - duration_weight * continuations.cost(termination)
}

/// The mean of `of` over the undiscounted returns of rollouts of three steps in that world, for a task that pays 1.
fn mean_over_returns(theta: &[f64], of: &dyn Fn(f64) -> f64) -> f64 {
    let draw = drawing_in(theta, 0);
    (0..2).map(|o| draw[o] * mean_from(theta, (0, o), (3, 0.0), of)).sum()
}

/// The same where option `o` acts in state `s`, with some steps left and something earned.
fn mean_from(
    theta: &[f64],
    (s, o): (usize, usize),
    (left, earned): (u32, f64),
    of: &dyn Fn(f64) -> f64,
) -> f64 {
    let ending = Termination { logit: theta[14] }.probability();
    let next = |state: usize, reward: f64| {
        if left == 1 {
            return of(earned + reward);
        }
        let draw = drawing_in(theta, state);
        let onward = |option: usize| mean_from(theta, (state, option), (left - 1, earned + reward), of);
        (1.0 - ending) * onward(o) + ending * (draw[0] * onward(0) + draw[1] * onward(1))
    };
    let f = forward(theta, s, o);
    match s {
        0 => f * (0.7 * next(0, 1.0) + 0.3 * next(1, 1.0)) + (1.0 - f) * next(0, 0.0),
        _ => f * next(1, -1.0) + (1.0 - f) * next(0, 1.0),
    }
}

/// What rollouts say of the gradient, in the layout of [`flat`], from the gradients that the networks are left with.
fn estimate(training: &mut Training<'_>, experience: &Experience, poor: Option<&[f64]>) -> Vec<f64> {
    let estimates = training.estimate(experience, poor);
    let signals = Signals::new(experience, &estimates);
    let config = config();
    let rows: Vec<usize> = (0..experience.steps.len()).collect();
    // Neighbours lie in different batches, which are of different sizes: each counts by its share of the steps.
    let batches = [3, 0, 1, 2, 4]
        .map(|batch| rows.iter().copied().filter(|row| row % 11 % 5 == batch).collect::<Vec<usize>>());
    let (mut policies, mut interests) = (Vec::new(), Vec::new());
    for batch in &batches {
        let signals = &signals;
        Batch { config: &config, experience, signals, usage: None, rows: batch }
            .differentiate(&mut training.learner);
        let share = batch.len() as f64 / rows.len() as f64;
        let Learner { policies: of_policies, interests: of_interests, .. } = &training.learner;
        let more = of_policies.iter().flat_map(|p| [&p.means.gradient[..], &p.log_std_gradient].concat());
        add(&mut policies, more, share);
        add(&mut interests, of_interests.iter().flat_map(|net| net.gradient.clone()), share);
    }

    // Losses are means over steps, of advantages with deviation 1; `J` is a sum over the steps of a rollout.
    let deviation = |of: &dyn Fn(&Advantages) -> f64, wanted: &dyn Fn(usize) -> bool| {
        let values: Vec<f64> =
            rows.iter().filter(|&&row| wanted(row)).map(|&row| of(&estimates.advantages[row])).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    };
    let visits = estimates.visits;
    let of_actions = -visits * deviation(&|a| a.action, &|_| true);
    let of_draws = -visits * deviation(&|a| a.draw, &|row| experience.steps[row].drawn);
    let end = training.termination_gradient(training.learner.termination, estimates.worth_of_ending());
    let scaled = |scale: f64| move |d: f64| scale * d;
    let policies = policies.into_iter().map(scaled(of_actions));
    policies.chain(interests.into_iter().map(scaled(of_draws))).chain([end]).collect()
}

/// Adds a share of `more` to `sums`.
fn add(sums: &mut Vec<f64>, more: impl Iterator<Item = f32>, share: f64) {
    let more = more.map(|d| share * f64::from(d));
    if sums.is_empty() { sums.extend(more) } else { sums.iter_mut().zip(more).for_each(|(sum, d)| *sum += d) }
}

/// Lets both options differ in both states.
fn prepare(learner: &mut Learner) {
    learner.policies[0].means.network.params_mut().copy_from_slice(&[0.9, -0.6, 0.1]);
    learner.policies[1].means.network.params_mut().copy_from_slice(&[-0.8, 0.5, -0.1]);
    learner.interests[0].network.params_mut().copy_from_slice(&[0.8, -0.7, 0.1]);
    learner.interests[1].network.params_mut().copy_from_slice(&[-0.6, 0.9, 0.0]);
}

/// Compares the mean of 40 estimates, each from a training of its own, with the derivatives of `objective`.
fn check(
    config: &InterestConfig,
    (world, pay, steps): (World, Range, usize),
    objective: impl Fn(&[f64]) -> f64,
    estimate: impl Fn(&mut Training<'_>, &Experience) -> Vec<f64>,
) {
    let tasks = TaskDistribution::new([("pay", pay)]);
    let initial_states = InitialStates { max_random_steps: 0, ..InitialStates::default() };
    let mut expected = Vec::new();
    let estimates: Vec<Vec<f64>> = (0..40)
        .map(|seed| {
            let practice = practice(&world, &tasks, &initial_states, steps, seed);
            let mut training = Training::new(config, &practice, &mut Unwatched).unwrap();
            // The critic, which no gradient of theirs should depend on, is another one each time.
            prepare(&mut training.learner);
            let experience = training.collect(&mut Unwatched).unwrap();
            let point = flat(&training.learner);
            if expected.is_empty() {
                expected = reference::differences(&point, &(0..point.len()).collect::<Vec<_>>(), &objective);
            }
            estimate(&mut training, &experience)
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

#[test]
fn the_gradient_of_training_has_the_exact_one_as_its_mean() {
    let world = (World::Hot, Range { low: 0.5, high: 1.5 }, 40);
    check(&config(), world, objective, |training, experience| estimate(training, experience, None));
}

/// Where nothing is discounted, steps that count alike count as `J` says; and where the task ends every rollout, the critic
/// has no say at all.
#[test]
fn steps_that_count_alike_have_the_exact_gradient_where_nothing_is_discounted() {
    let config = InterestConfig {
        steps: 30_000,
        rollout_steps: 30_000,
        context_pool: 10_000,
        discount: Discounts { gamma: 1.0, gae_lambda: 1.0 },
        discounted_visits: false,
        ..config()
    };
    let objective = |theta: &[f64]| {
        let cost = config.continuations.cost(Termination { logit: theta[14] });
        mean_over_returns(theta, &|earned| earned) - config.duration_weight * cost
    };
    let world = (World::BrieflyHot, Range { low: 1.0, high: 1.0 }, 40);
    check(&config, world, objective, |training, experience| {
        assert!(experience.ends.iter().filter(|end| **end == LastState::Terminal).count() > 9_990);
        estimate(training, experience, None)
    });
}

/// Half the mean squared error of `Q(s, o)` for the option that acted, whichever others the critic has a word on.
#[test]
fn the_gradient_of_the_critic_is_that_of_its_loss() {
    let config = InterestConfig { steps: 300, rollout_steps: 300, hidden: vec![5], ..config() };
    let tasks = TaskDistribution::new([("pay", Range { low: 0.5, high: 1.5 })]);
    let initial_states = InitialStates { max_random_steps: 0, ..InitialStates::default() };
    let practice = practice(&World::Hot, &tasks, &initial_states, 10, 1);
    let mut training = Training::new(&config, &practice, &mut Unwatched).unwrap();
    let experience = training.collect(&mut Unwatched).unwrap();
    let estimates = training.estimate(&experience, None);
    let signals = Signals::new(&experience, &estimates);
    let rows: Vec<usize> = (0..experience.steps.len()).filter(|row| row % 3 != 1).collect();
    Batch { config: &config, experience: &experience, signals: &signals, usage: None, rows: &rows }
        .differentiate(&mut training.learner);

    let critic = &training.learner.critic;
    let width = critic.network.input_size();
    let sizes = [width, 5, 2];
    let loss = |params: &[f64]| {
        let errors = rows.iter().map(|&row| {
            let input = &experience.critic_inputs[row * width..][..width];
            let q = reference::forward(&sizes, params, input)[experience.options[row]];
            // An estimate of the discounted return, so it is no part of what is differentiated.
            0.5 * (q - f64::from(estimates.targets[row])).powi(2)
        });
        errors.sum::<f64>() / rows.len() as f64
    };
    assert_eq!(width, 3, "two numbers that are observed, and one of the task");
    let point: Vec<f64> = critic.network.params().iter().map(|x| f64::from(*x)).collect();
    let exact = reference::differences(&point, &(0..point.len()).collect::<Vec<_>>(), loss);
    let error = reference::relative_error(&critic.gradient, &exact);
    assert!(error < 1e-4, "{error}");
}

#[test]
fn the_price_of_poor_returns_has_the_exact_gradient_as_its_mean() {
    let config = InterestConfig { steps: 30_000, rollout_steps: 30_000, context_pool: 10_000, ..config() };
    let theta = {
        let tasks = TaskDistribution::default();
        let initial_states = InitialStates::default();
        let practice = practice(&World::Hot, &tasks, &initial_states, 3, 0);
        let mut learner = Training::new(&config, &practice, &mut Unwatched).unwrap().learner;
        prepare(&mut learner);
        flat(&learner)
    };
    // Returns are whole numbers; that of a rollout is poor when it is below ½.
    let threshold = 0.5;
    let mean = mean_over_returns(&theta, &|earned| earned);
    let deviation = (mean_over_returns(&theta, &|earned| earned * earned) - mean * mean).sqrt();
    let risk = Risk::NegativeTail { k: 2.0, alpha: (mean - threshold) / deviation };
    let price = |theta: &[f64]| -2.0 * mean_over_returns(theta, &|earned| f64::from(earned < threshold));
    for discounted_visits in [true, false] {
        let config = InterestConfig { discounted_visits, ..config.clone() };
        let world = (World::Hot, Range { low: 1.0, high: 1.0 }, 3);
        check(&config, world, price, |training, experience| {
            let prices = risk::poor(experience, risk, 1.0).unwrap();
            let with = estimate(training, experience, Some(&prices));
            let without = estimate(training, experience, None);
            with.iter().zip(without).map(|(with, without)| with - without).collect()
        });
    }
}
