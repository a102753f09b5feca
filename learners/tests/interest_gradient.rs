//! The gradients of §6.2 against finite differences of an objective that is computed exactly, by linear algebra.

mod chain;

use chain::{ACTIONS, BAND, COST_WEIGHT, GAMMA, OptionValues, Parameters, STATES, TASKS, Taken};
use elo_core::seed::Seed;
use elo_learners::interest::advantages::{Advantages, advantages, value_target};
use elo_learners::interest::drawing;
use elo_learners::interest::duration::{Termination, clipped_end};
use elo_learners::kernels::gae::{Discount, StepEnd, Trajectory, gae};

/// Central differences of `of` at `point`.
fn differences(point: &[f64], of: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let step = 1e-5;
    let moved = |i: usize, by: f64| {
        let mut moved = point.to_vec();
        moved[i] += by;
        of(&moved)
    };
    (0..point.len()).map(|i| (moved(i, step) - moved(i, -step)) / (2.0 * step)).collect()
}

/// Adds one step's share of `∇J`, in the layout of [`Parameters::flat`]: the three parts of the gradient.
fn add_step(theta: &Parameters, taken: &Taken, advantages: &Advantages, weight: f64, gradient: &mut [f64]) {
    let Taken { state, option, action, step } = *taken;
    let interests = theta.options() * STATES;
    let right = theta.policy(option, state)[1];
    gradient[option * STATES + state] += weight * advantages.action * (action as f64 - right);
    if step.drawn {
        let mut d_log_interests = vec![0.0; theta.options()];
        drawing::log_probability(&theta.log_interests_at(state), option, &mut d_log_interests);
        for (other, d) in d_log_interests.iter().enumerate() {
            gradient[interests + other * STATES + state] += weight * advantages.draw * d;
        }
    }
    let end = clipped_end(theta.termination, theta.termination, advantages.end, 0.2);
    gradient[2 * interests] += weight * GAMMA * end;
}

/// The part of `∇J` that no rollout is needed for.
fn add_cost(theta: &Parameters, gradient: &mut [f64]) {
    gradient[2 * theta.options() * STATES] -= COST_WEIGHT * BAND.d_cost(theta.termination);
}

/// `∇J` as the sum over every step that can happen, each with its exact weight and with the exact critic.
fn exact_gradient(theta: &Parameters) -> Vec<f64> {
    let mut gradient = vec![0.0; theta.flat().len()];
    let visits = chain::visits(theta);
    for task in 0..TASKS {
        let values = chain::exact_values(theta, task);
        for index in 0..STATES * theta.options() * ACTIONS * (STATES + 1) {
            let (after, rest) = (index % (STATES + 1), index / (STATES + 1));
            let (action, rest) = (rest % ACTIONS, rest / ACTIONS);
            let (option, state) = (rest % theta.options(), rest / theta.options());
            let ways = chain::next(state, action);
            let way = ways.get(after).copied().unwrap_or(1.0 - ways.iter().sum::<f64>());
            let chance = theta.policy(option, state)[action] * way / TASKS as f64;
            let after = (after < STATES).then_some(after);
            let mut step = chain::step(theta, &values, task, [state, option, action], after);
            step.last = true;
            for (drawn, visits) in [false, true].into_iter().zip(visits[state][option]) {
                step.drawn = drawn;
                let mut got = [Advantages::default()];
                advantages(&[step], theta.termination, Discount { gamma: GAMMA, lambda: 0.0 }, &mut got);
                let taken = Taken { state, option, action, step };
                add_step(theta, &taken, &got[0], visits * chance, &mut gradient);
            }
        }
    }
    add_cost(theta, &mut gradient);
    gradient
}

/// Means and standard errors of gradient estimates, one a rollout; after `∇J` come the derivatives by the critic's
/// values of `½ Σ γ^t (Q − target)²`, `[task][state][option]`.
struct Sampled {
    means: Vec<f64>,
    errors: Vec<f64>,
}

fn sampled_gradient(theta: &Parameters, critic: &[OptionValues], lambda: f64, rollouts: u64) -> Sampled {
    let (size, options) = (theta.flat().len(), theta.options());
    let total = size + TASKS * STATES * options;
    let (mut sums, mut squares) = (vec![0.0; total], vec![0.0; total]);
    for index in 0..rollouts {
        let mut noise = Seed::root(7).index(index).stream();
        let task = index as usize % TASKS;
        let taken = chain::rollout(theta, &critic[task], task, &mut noise);
        let steps: Vec<_> = taken.iter().map(|taken| taken.step).collect();
        let mut got = vec![Advantages::default(); steps.len()];
        advantages(&steps, theta.termination, Discount { gamma: GAMMA, lambda }, &mut got);
        let mut gradient = vec![0.0; total];
        let mut weight = 1.0;
        for (taken, advantages) in taken.iter().zip(&got) {
            add_step(theta, taken, advantages, weight, &mut gradient);
            let error = taken.step.here.option - value_target(&taken.step, advantages);
            gradient[size + (task * STATES + taken.state) * options + taken.option] += weight * error;
            weight *= GAMMA;
        }
        add_cost(theta, &mut gradient);
        for ((sum, square), g) in sums.iter_mut().zip(&mut squares).zip(gradient) {
            *sum += g;
            *square += g * g;
        }
    }
    let n = rollouts as f64;
    let means: Vec<f64> = sums.iter().map(|sum| sum / n).collect();
    let errors =
        squares.iter().zip(&means).map(|(square, mean)| ((square / n - mean * mean) / n).sqrt()).collect();
    Sampled { means, errors }
}

/// `½ mean_τ Σ γ^t E[(Q − Q^θ)²]` by the critic's values, by finite differences.
fn critic_gradient(theta: &Parameters, critic: &[OptionValues]) -> Vec<f64> {
    let visits = chain::visits(theta);
    let exact: Vec<OptionValues> = (0..TASKS).map(|task| chain::exact_values(theta, task)).collect();
    let (truth, point) = (exact.concat().concat(), critic.concat().concat());
    let weights: Vec<f64> =
        visits.concat().iter().map(|[stay, drawn]| (stay + drawn) / TASKS as f64).collect();
    differences(&point, |values| {
        let squares = values.iter().zip(&truth).zip(weights.iter().cycle());
        squares.map(|((v, t), w)| 0.5 * w * (v - t).powi(2)).sum()
    })
}

fn length(vector: &[f64]) -> f64 {
    vector.iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[test]
fn the_values_obey_the_equations() {
    // Eq. 6.4 and 6.5, written out once more.
    let theta = Parameters::sample();
    let ending = theta.termination.probability();
    for task in 0..TASKS {
        let q = chain::exact_values(&theta, task);
        let v = |s: usize| drawing::state_value(&theta.drawing(s), &q[s]);
        for (state, option) in (0..STATES).flat_map(|s| [(s, 0), (s, 1)]) {
            let q_u = |action: usize| {
                let after = chain::next(state, action);
                let beyond = |s: usize| (1.0 - ending) * q[s][option] + ending * v(s);
                chain::reward(task, state, action)
                    + GAMMA * (0..STATES).map(|s| after[s] * beyond(s)).sum::<f64>()
            };
            let policy = theta.policy(option, state);
            let expected: f64 = (0..ACTIONS).map(|action| policy[action] * q_u(action)).sum();
            assert!((q[state][option] - expected).abs() < 1e-12);
        }
    }
}

#[test]
fn the_three_parts_are_the_gradient_of_the_objective() {
    for continuations in [0.2, 2.0, 5.0, 30.0] {
        let mut theta = Parameters::sample();
        theta.termination = Termination::lasting(continuations);
        let expected = differences(&theta.flat(), |flat| chain::objective(&theta.with(flat)));
        let got = exact_gradient(&theta);
        assert!(expected.iter().all(|d| d.abs() > 1e-7), "every parameter matters: {expected:?}");
        for (index, (got, expected)) in got.iter().zip(&expected).enumerate() {
            let error = (got - expected).abs();
            assert!(error < 1e-7 * expected.abs().max(1.0), "parameter {index}: {got} against {expected}");
        }
    }
}

#[test]
fn sampled_gradients_have_the_exact_one_as_their_mean() {
    let theta = Parameters::sample();
    let exact: Vec<OptionValues> = (0..TASKS).map(|task| chain::exact_values(&theta, task)).collect();
    let gradient = differences(&theta.flat(), |flat| chain::objective(&theta.with(flat)));
    // A critic that is wrong everywhere, and not alike for the options.
    let wrong: Vec<OptionValues> = (0..TASKS)
        .map(|task| (0..STATES).map(|s| vec![0.5 * s as f64 - task as f64, 1.5 - 0.7 * s as f64]).collect())
        .collect();
    // The right critic may be trusted to any degree, a wrong one not at all: then λ is 1.
    for (critic, lambda) in [(&exact, 0.0), (&exact, 0.7), (&exact, 1.0), (&wrong, 1.0)] {
        let Sampled { means, errors } = sampled_gradient(&theta, critic, lambda, 40_000);
        let expected = [gradient.clone(), critic_gradient(&theta, critic)].concat();
        for (index, ((mean, error), expected)) in means.iter().zip(&errors).zip(&expected).enumerate() {
            let distance = (mean - expected).abs() / error;
            assert!(distance < 4.0, "λ = {lambda}, number {index}: {mean} ± {error}, exactly {expected}");
        }
        let size = gradient.len();
        let noise = length(&errors[..size]) / length(&gradient);
        assert!(noise < 0.05, "λ = {lambda}: standard errors of {noise} of the gradient show nothing");
    }
}

#[test]
fn a_wrong_critic_alone_gives_a_wrong_gradient() {
    // What the test above would not notice if estimates ignored the critic.
    let theta = Parameters::sample();
    let wrong = vec![vec![vec![1.0, -1.0]; STATES]; TASKS];
    let gradient = differences(&theta.flat(), |flat| chain::objective(&theta.with(flat)));
    let Sampled { means, errors } = sampled_gradient(&theta, &wrong, 0.0, 4_000);
    let apart = (0..gradient.len()).filter(|&i| (means[i] - gradient[i]).abs() > 10.0 * errors[i]).count();
    assert!(apart > gradient.len() / 2, "{apart}");
}

#[test]
fn one_option_has_the_plain_policy_gradient() {
    // Drawing and ending then mean nothing: whatever ε is, values and policy gradients are those of one policy.
    let theta = Parameters {
        right: vec![[0.4, -0.3, 1.1, 0.2]],
        log_interests: vec![[0.7, -0.4, 0.1, 0.9]],
        ..Parameters::sample()
    };
    let critic = vec![vec![0.5], vec![1.5], vec![-1.0], vec![2.0]];
    for index in 0..20 {
        let taken = chain::rollout(&theta, &critic, 0, &mut Seed::root(3).index(index).stream());
        let steps: Vec<_> = taken.iter().map(|taken| taken.step).collect();
        let discount = Discount { gamma: GAMMA, lambda: 0.8 };
        let mut got = vec![Advantages::default(); steps.len()];
        advantages(&steps, theta.termination, discount, &mut got);
        let mut gradient = vec![0.0; theta.flat().len()];
        for (taken, advantages) in taken.iter().zip(&got) {
            add_step(&theta, taken, advantages, 1.0, &mut gradient);
        }

        let rewards: Vec<f32> = steps.iter().map(|step| step.reward as f32).collect();
        let values: Vec<f32> = taken.iter().map(|taken| critic[taken.state][0] as f32).collect();
        let mut ends = vec![StepEnd::Running; steps.len()];
        ends[steps.len() - 1] = StepEnd::Terminated;
        let mut plain = vec![0.0; steps.len()];
        let trajectory = Trajectory { rewards: &rewards, values: &values, ends: &ends, value_after: 0.0 };
        gae(&trajectory, discount, &mut plain);
        let mut expected = [0.0; STATES];
        for (taken, advantage) in taken.iter().zip(plain) {
            let right = theta.policy(0, taken.state)[1];
            expected[taken.state] += f64::from(advantage) * (taken.action as f64 - right);
        }
        for (got, expected) in gradient.iter().zip(expected) {
            assert!((got - expected).abs() < 1e-4, "{got} against {expected}");
        }
        assert!(gradient[STATES..2 * STATES].iter().all(|d| *d == 0.0), "interests: {gradient:?}");
    }
    let longer = Parameters { termination: Termination::lasting(50.0), ..theta.clone() };
    for (short, long) in chain::exact_values(&theta, 1).iter().zip(chain::exact_values(&longer, 1)) {
        assert!((short[0] - long[0]).abs() < 1e-12);
    }
}

#[test]
fn equal_interests_are_the_agent_that_draws_uniformly() {
    let mut theta = Parameters::sample();
    let critic = chain::exact_values(&theta, 0);
    theta.log_interests = vec![[0.0; STATES]; 2];
    let uniform: Vec<_> =
        chain::rollout(&theta, &critic, 0, &mut Seed::root(9).stream()).iter().map(|t| t.option).collect();
    let value = chain::objective(&theta);
    for state in 0..STATES {
        assert_eq!(theta.drawing(state), [0.5, 0.5]);
        let q = &chain::exact_values(&theta, 1)[state];
        assert_eq!(drawing::state_value(&theta.drawing(state), q), (q[0] + q[1]) / 2.0);
    }
    // Only ratios count, state by state.
    theta.log_interests = vec![[0.5, -2.0, 30.0, 1.0]; 2];
    let scaled = chain::rollout(&theta, &critic, 0, &mut Seed::root(9).stream());
    assert_eq!(scaled.iter().map(|taken| taken.option).collect::<Vec<_>>(), uniform);
    assert_eq!(chain::objective(&theta), value);
}
