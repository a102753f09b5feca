//! A chain of four states in which everything about §6.2 can be computed exactly, in double precision.
//!
//! Two actions move left or right, and slip to the other side in a fifth of the cases. Beyond the right end the episode
//! terminates. Two tasks pay differently. Two options have a policy and an interest for each state, as logits.

use elo_core::agent::pick;
use elo_core::seed::Stream;
use elo_learners::interest::advantages::{Step, Values};
use elo_learners::interest::drawing;
use elo_learners::interest::duration::{Band, Termination};
use faer::Mat;
use faer::prelude::Solve as _;
use rand::RngExt as _;

/// `|S|`.
pub const STATES: usize = 4;
/// Left and right.
pub const ACTIONS: usize = 2;
/// Tasks, all equally likely.
pub const TASKS: usize = 2;
/// `γ`.
pub const GAMMA: f64 = 0.9;
/// `λ` of Eq. 6.1.
pub const COST_WEIGHT: f64 = 0.3;
/// The durations that cost nothing.
pub const BAND: Band = Band { low: 4.0, high: 6.0 };

/// `θ` for some number of options: log-odds of going right and log-interests, both `[option][state]`, and `ε`.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    pub right: Vec<[f64; STATES]>,
    pub log_interests: Vec<[f64; STATES]>,
    pub termination: Termination,
}

/// `Q[state][option]` in one task.
pub type OptionValues = Vec<Vec<f64>>;

impl Parameters {
    /// Two options that are not alike anywhere.
    pub fn sample() -> Self {
        Self {
            right: vec![[0.4, -0.3, 1.1, 0.2], [-0.8, 0.9, -0.1, 0.5]],
            log_interests: vec![[0.7, -0.4, 0.1, 0.9], [-0.2, 0.6, -0.5, 0.3]],
            termination: Termination::lasting(2.0),
        }
    }

    /// `K`.
    pub fn options(&self) -> usize {
        self.right.len()
    }

    /// All numbers in a row.
    pub fn flat(&self) -> Vec<f64> {
        [self.right.concat(), self.log_interests.concat(), vec![self.termination.logit]].concat()
    }

    /// The inverse of [`Self::flat`], for as many options as `self` has.
    pub fn with(&self, flat: &[f64]) -> Self {
        let (rows, [logit]) = flat.as_chunks::<STATES>() else { panic!("parameters of a chain") };
        let (right, log_interests) = rows.split_at(self.options());
        let termination = Termination { logit: *logit };
        Self { right: right.to_vec(), log_interests: log_interests.to_vec(), termination }
    }

    /// `π_o(·|s)`.
    pub fn policy(&self, option: usize, state: usize) -> [f64; ACTIONS] {
        let right = 1.0 / (1.0 + (-self.right[option][state]).exp());
        [1.0 - right, right]
    }

    /// `z_·(s)`.
    pub fn log_interests_at(&self, state: usize) -> Vec<f64> {
        self.log_interests.iter().map(|row| row[state]).collect()
    }

    /// `π_I(·|s)`.
    pub fn drawing(&self, state: usize) -> Vec<f64> {
        let mut probabilities = vec![0.0; self.options()];
        drawing::probabilities(&self.log_interests_at(state), &mut probabilities);
        probabilities
    }
}

/// `p(s'|s,a)`; what is missing to 1 terminates the episode.
pub fn next(state: usize, action: usize) -> [f64; STATES] {
    let mut probabilities = [0.0; STATES];
    probabilities[state.saturating_sub(1)] += if action == 0 { 0.8 } else { 0.2 };
    if state + 1 < STATES {
        probabilities[state + 1] += if action == 1 { 0.8 } else { 0.2 };
    }
    probabilities
}

/// `r(s,a|τ)`: one task pays for going right and for states on the right, the other for going left in the middle.
pub fn reward(task: usize, state: usize, action: usize) -> f64 {
    match task {
        0 => 0.5 * state as f64 + if action == 1 { 0.6 } else { -0.4 },
        _ => {
            if (state == 1 || state == 2) && action == 0 {
                1.5
            } else {
                -0.3
            }
        }
    }
}

/// `d0`.
pub const START: [f64; STATES] = [0.4, 0.3, 0.2, 0.1];

/// `P(s', o' | s, o)` of the infant agent and whether the option was drawn anew: `[continued, drawn]`.
fn transition(theta: &Parameters, from: (usize, usize), to: (usize, usize)) -> [f64; 2] {
    let ((state, option), (state_after, option_after)) = (from, to);
    let policy = theta.policy(option, state);
    let arrival: f64 = (0..ACTIONS).map(|a| policy[a] * next(state, a)[state_after]).sum();
    let ending = theta.termination.probability();
    let stays = if option == option_after { arrival * (1.0 - ending) } else { 0.0 };
    [stays, arrival * ending * theta.drawing(state_after)[option_after]]
}

/// `I − γ P`, over pairs of state and option.
fn resolvent(theta: &Parameters) -> Mat<f64> {
    let k = theta.options();
    Mat::from_fn(STATES * k, STATES * k, |row, column| {
        let [stays, drawn] = transition(theta, (row / k, row % k), (column / k, column % k));
        f64::from(row == column) - GAMMA * (stays + drawn)
    })
}

/// `Q^θ(s,o|τ)`, the solution of Eq. 6.4 and 6.5.
pub fn exact_values(theta: &Parameters, task: usize) -> OptionValues {
    let k = theta.options();
    let rewards = Mat::from_fn(STATES * k, 1, |row, _| {
        let policy = theta.policy(row % k, row / k);
        (0..ACTIONS).map(|a| policy[a] * reward(task, row / k, a)).sum()
    });
    let values = resolvent(theta).partial_piv_lu().solve(&rewards);
    (0..STATES).map(|s| (0..k).map(|o| values[(s * k + o, 0)]).collect()).collect()
}

/// `Σ_t γ^t P(s_t = s, o_t = o)`, `[state][option]` of `[continued, drawn]`: how much a step there weighs.
pub fn visits(theta: &Parameters) -> Vec<Vec<[f64; 2]>> {
    let k = theta.options();
    let begun = |s: usize, o: usize| START[s] * theta.drawing(s)[o];
    let start = Mat::from_fn(STATES * k, 1, |row, _| begun(row / k, row % k));
    let transposed = resolvent(theta).transpose().to_owned();
    let all = transposed.partial_piv_lu().solve(&start);
    let split = |s: usize, o: usize| {
        let mut parts = [0.0, begun(s, o)];
        for row in 0..STATES * k {
            let flows = transition(theta, (row / k, row % k), (s, o));
            parts.iter_mut().zip(flows).for_each(|(part, flow)| *part += GAMMA * all[(row, 0)] * flow);
        }
        parts
    };
    (0..STATES).map(|s| (0..k).map(|o| split(s, o)).collect()).collect()
}

/// `J(θ)` of Eq. 6.1.
pub fn objective(theta: &Parameters) -> f64 {
    let value = |task: usize| {
        let values = exact_values(theta, task);
        (0..STATES).map(|s| START[s] * drawing::state_value(&theta.drawing(s), &values[s])).sum::<f64>()
    };
    (0..TASKS).map(value).sum::<f64>() / TASKS as f64 - COST_WEIGHT * BAND.cost(theta.termination)
}

/// One step and what decided it.
#[derive(Clone, Copy, Debug)]
pub struct Taken {
    pub state: usize,
    pub option: usize,
    pub action: usize,
    pub step: Step,
}

/// The step from `s` by `o` and `a`, as a critic with `values` sees it.
pub fn step(
    theta: &Parameters,
    values: &OptionValues,
    task: usize,
    decided: [usize; 3],
    after: Option<usize>,
) -> Step {
    let [state, option, action] = decided;
    let seen = |s: usize| Values {
        option: values[s][option],
        state: drawing::state_value(&theta.drawing(s), &values[s]),
    };
    Step {
        drawn: true,
        reward: reward(task, state, action),
        here: seen(state),
        after: after.map(seen).unwrap_or_default(),
        last: after.is_none(),
    }
}

/// One rollout of the infant agent in `task`, to its end (or to where `γ^t` is nothing), seen by a critic.
pub fn rollout(theta: &Parameters, values: &OptionValues, task: usize, noise: &mut Stream) -> Vec<Taken> {
    let mut taken: Vec<Taken> = Vec::new();
    let mut at = Some(pick(&START, noise.random()));
    let mut running = None;
    while let Some(state) = at {
        let option = running.unwrap_or_else(|| pick(&theta.drawing(state), noise.random()));
        let action = pick(&theta.policy(option, state), noise.random());
        let mut ways = next(state, action).to_vec();
        ways.push(1.0 - ways.iter().sum::<f64>());
        let arrived = pick(&ways, noise.random());
        let after = (arrived < STATES).then_some(arrived);
        let mut step = step(theta, values, task, [state, option, action], after);
        step.drawn = running.is_none();
        step.last |= taken.len() + 1 == 300;
        taken.push(Taken { state, option, action, step });
        running = (noise.random::<f64>() >= theta.termination.probability()).then_some(option);
        at = if step.last { None } else { after };
    }
    taken
}
