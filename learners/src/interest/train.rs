//! The training, from top to bottom: roll out the infant agent, estimate advantages, improve the policies, the interests
//! and `ε`, and the critic.

use elo_core::context::Context;
use elo_core::policy::{Monitor, OptionLearner as _, Practice, TrainError};
use elo_core::simulator::Simulator;
use elo_core::spec::SimulatorSpec;
use elo_core::task::Task;
use rand::RngExt as _;
use rand::seq::SliceRandom as _;
use serde::{Deserialize, Serialize};

use super::advantages::{Advantages, advantages, value_target};
use super::batch::Batch;
use super::config::InterestConfig;
use super::duration::{Termination, clipped_end};
use super::imitation;
use super::learner::{Learner, Net, Policy};
use super::policy::InterestPolicy;
use super::practice::{Episode, Experience, Infant};
use super::risk::{self, Risk};
use super::valuation;
use crate::acting::{Tally, draw_contexts};
use crate::fields::refuse_faults;
use crate::kernels::clipped_surrogate::typical_kl;
use crate::kernels::gae::normalize;
use crate::kernels::running_moments::{Normalizer, ReturnScaler, RunningMoments};
use crate::nn::Scratch;
use crate::normalized_mlp::NormalizedMlp;

/// A set of options, learned together.
#[derive(Clone, Debug, PartialEq)]
pub struct Learned {
    /// The options; the infant agent draws them by their interests.
    pub options: Vec<InterestPolicy>,
    /// What was seen in each iteration.
    pub curve: Vec<Point>,
}

/// One iteration of a training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Control steps taken so far.
    pub steps: u64,
    /// Mean undiscounted return of the rollouts.
    pub mean_return: f64,
    /// Their mean length in control steps.
    pub mean_length: f64,
    /// Mean number of actions of the options, `1/ε`.
    pub actions: f64,
    /// Mean number of continuations, `ρ = (1 − ε)/ε`.
    pub continuations: f64,
}

/// Learns options that maximise `J(θ)` (Eq. 6.1).
///
/// # Errors
/// See [`TrainError`].
pub fn train(
    config: &InterestConfig,
    practice: &Practice<'_>,
    monitor: &mut dyn Monitor,
) -> Result<Learned, TrainError> {
    let mut training = Training::new(config, practice)?;
    match monitor.resume() {
        Some(bytes) => training.restore(&bytes)?,
        None => training.imitate()?,
    }
    while training.goes_on() {
        let before = training.record.tally.steps;
        training.iterate()?;
        let done = training.record.tally.steps;
        monitor.progress(done, config.steps)?;
        let is_due = done / config.checkpoint_every > before / config.checkpoint_every;
        if is_due && training.goes_on() {
            let bytes = training.checkpoint();
            monitor.checkpoint(&bytes)?;
            training.restore(&bytes)?;
        }
    }
    Ok(training.finish())
}

/// A training on its way.
pub(super) struct Training<'a> {
    config: &'a InterestConfig,
    practice: &'a Practice<'a>,
    simulator: Box<dyn Simulator>,
    spec: SimulatorSpec,
    /// Where rollouts begin, and for what.
    contexts: Vec<Context>,
    /// The scale of observations, where practice begins from recordings.
    scale: Option<Normalizer>,
    /// What is being trained.
    pub learner: Learner,
    /// How far it is, and what was seen.
    pub record: Record,
}

/// The part of a training that is no network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
    /// Iterations done.
    pub iteration: u64,
    /// Of all observations acted on.
    moments: RunningMoments,
    /// Scale of the rewards.
    scaler: ReturnScaler,
    /// Counts.
    tally: Tally,
    /// One point an iteration.
    curve: Vec<Point>,
}

impl<'a> Training<'a> {
    /// Before the first iteration.
    pub fn new(config: &'a InterestConfig, practice: &'a Practice<'a>) -> Result<Self, TrainError> {
        refuse_faults(|faults| config.validate(faults)).map_err(TrainError::Other)?;
        let mut simulator = practice.simulator.build()?;
        let spec = simulator.spec().clone();
        let seed = practice.seed.child("contexts");
        let tasks = (0..config.context_pool)
            .map(|index| practice.tasks.draw(&mut seed.child("task").index(index).stream()));
        let contexts =
            draw_contexts(practice.initial_states, simulator.as_mut(), tasks, &seed.child("start"))?;
        Ok(Self {
            contexts,
            scale: imitation::scale(config, practice, &spec)?,
            learner: Learner::new(config, practice, &spec),
            record: Record {
                iteration: 0,
                moments: RunningMoments::new(spec.observation_size),
                scaler: ReturnScaler::new(1, config.discount.gamma),
                tally: Tally::default(),
                curve: Vec::new(),
            },
            config,
            practice,
            simulator,
            spec,
        })
    }

    /// Lets the options begin from recordings, if they are to.
    fn imitate(&mut self) -> Result<(), TrainError> {
        let Self { learner, practice, scale, .. } = self;
        scale.as_ref().map_or(Ok(()), |scale| imitation::imitate(learner, practice, scale))
    }

    /// How observations are scaled in this iteration.
    fn normalizer(&self) -> Normalizer {
        self.scale.clone().unwrap_or_else(|| self.record.moments.normalizer())
    }

    /// Whether not all steps have been taken.
    pub fn goes_on(&self) -> bool {
        self.record.tally.steps < self.config.steps
    }

    /// One improvement, `θ_k → θ_{k+1}`.
    pub fn iterate(&mut self) -> Result<(), TrainError> {
        let mut experience = self.collect()?;
        self.log(&experience);
        self.scale_rewards(&mut experience);
        self.estimate_advantages(&mut experience);
        self.improve(&experience)
            .map_err(|reason| TrainError::Diverged { steps: self.record.tally.steps, reason })?;
        self.record.iteration += 1;
        Ok(())
    }

    /// Rolls out the infant agent in contexts of the pool.
    pub fn collect(&mut self) -> Result<Experience, TrainError> {
        let seed = self.practice.seed.child("rollouts").index(self.record.iteration);
        let left = self.config.steps - self.record.tally.steps;
        // What is left, divided evenly.
        let wanted = left.div_ceil(left.div_ceil(self.config.rollout_steps));
        let mut experience = Experience::default();
        let normalizer = self.normalizer();
        // Those that fail without a step are few, or else end the training.
        for rollout in 0.. {
            let done = experience.steps.len() as u64;
            if done >= wanted {
                break;
            }
            let seed = seed.index(rollout);
            let which = seed.child("context").stream().random_range(0..self.contexts.len());
            let context = &self.contexts[which];
            let features = self.task_features(&context.task);
            let episode = Episode {
                context,
                features: &features,
                max_steps: (left - done).min(self.practice.steps as u64),
                gamma: self.config.discount.gamma,
            };
            self.record.tally.episodes += 1;
            let mut infant = Infant {
                learner: &self.learner,
                normalizer: &normalizer,
                moments: &mut self.record.moments,
                experience: &mut experience,
                scratch: Scratch::default(),
            };
            let noise = &mut seed.child("noise").stream();
            if let Err(error) = infant.roll_out(self.simulator.as_mut(), &episode, noise) {
                self.record.tally.fail(&error)?;
            }
        }
        self.record.tally.steps += experience.steps.len() as u64;
        Ok(experience)
    }

    /// The parameters that `P` draws, each between −1 and 1 within what the simulator allows.
    fn task_features(&self, task: &Task) -> Vec<f32> {
        let feature = |name: &str| {
            let (low, high) = self.spec.task_parameter(name).map_or((0.0, 0.0), |p| (p.low, p.high));
            let middle = 0.5 * (low + high);
            if high > low {
                (2.0 * (self.spec.parameter_value(task, name) - middle) / (high - low)) as f32
            } else {
                0.0
            }
        };
        self.practice.tasks.names().map(feature).collect()
    }

    /// Divides rewards by the deviation of the discounted returns seen so far, then takes the price of risk from them.
    fn scale_rewards(&mut self, experience: &mut Experience) {
        for step in &experience.steps {
            self.record.scaler.scale(0, step.reward);
            if step.last {
                self.record.scaler.end_episode(0);
            }
        }
        let factor = self.record.scaler.factor();
        let poor = match self.config.risk {
            Risk::Mean => None,
            Risk::NegativeTail { k, alpha } => Some((risk::poor(&experience.steps, alpha), k)),
        };
        experience.steps.iter_mut().for_each(|step| step.reward *= factor);
        if let Some((poor, price)) = poor {
            risk::charge(&mut experience.steps, &poor, price);
        }
    }

    /// Of the three kinds of decisions, by the critic that saw the steps.
    pub fn estimate_advantages(&mut self, experience: &mut Experience) {
        valuation::value(&mut self.learner, experience);
        let Experience { steps, advantages: to, .. } = experience;
        to.resize(steps.len(), Advantages::default());
        advantages(steps, self.learner.termination, self.config.discount.into(), to);
    }

    /// Epochs of gradient steps on shuffled minibatches, and after each one on `ε`. The error says why it cannot go on.
    fn improve(&mut self, experience: &Experience) -> Result<(), String> {
        let config = self.config;
        let iteration = self.record.iteration;
        let rates = config.rates(self.record.tally.steps - experience.steps.len() as u64);
        let weights = self.weights(experience);
        let worth = self.worth_of_ending(experience, &weights);
        let signals = Signals::new(experience, &weights);
        let before = self.learner.termination;
        let count = experience.steps.len();
        let mut order: Vec<usize> = (0..count).collect();
        // Of equal size, so that none is a handful of steps.
        let batches = (count / config.minibatch).max(1);
        let mut shuffler = self.practice.seed.child("shuffle").index(iteration).stream();
        for _ in 0..config.epochs {
            order.shuffle(&mut shuffler);
            let mut moved = Vec::with_capacity(batches);
            for rows in order.chunks(count.div_ceil(batches)) {
                let batch = Batch { config, experience, signals: &signals, rows };
                moved.push(batch.differentiate(&mut self.learner));
                self.learner.descend(rates, config.max_grad_norm)?;
            }
            let gradient = self.termination_gradient(before, worth);
            if !gradient.is_finite() {
                return Err(format!("the gradient of the termination probability is {gradient}"));
            }
            self.learner.ascend_termination(gradient, rates.termination);
            if f64::from(typical_kl(moved)) >= config.target_kl {
                break;
            }
        }
        self.learner.divergence().map_or(Ok(()), Err)
    }

    /// `dJ/dx = Σ_t w_t γ ε(1 − ε) A_end(t) − λ dφ/dx`, in the mean over rollouts; the first part clipped.
    pub fn termination_gradient(&self, before: Termination, worth: f64) -> f64 {
        let InterestConfig { continuations, duration_weight, clip, .. } = self.config;
        let now = self.learner.termination;
        clipped_end(now, before, worth, *clip) - duration_weight * continuations.d_cost(now)
    }

    /// What each step counts, with mean 1.
    pub fn weights(&self, experience: &Experience) -> Vec<f64> {
        let count = experience.steps.len() as f64;
        let mean = experience.discounts.iter().sum::<f64>() / count;
        let weight = |discount: &f64| if self.config.discounted_visits { discount / mean } else { 1.0 };
        experience.discounts.iter().map(weight).collect()
    }

    /// `dV/dε`: what ending is worth in the mean over steps, times the sum of `γ^t` in a rollout.
    pub fn worth_of_ending(&self, experience: &Experience, weights: &[f64]) -> f64 {
        let rollouts = experience.steps.iter().filter(|step| step.last).count() as f64;
        let visits = experience.discounts.iter().sum::<f64>() / rollouts;
        let ends = experience.advantages.iter().zip(weights).map(|(advantages, w)| w * advantages.end);
        self.config.discount.gamma * visits * ends.sum::<f64>() / weights.len() as f64
    }

    fn log(&mut self, experience: &Experience) {
        let rollouts = experience.steps.iter().filter(|step| step.last).count() as f64;
        let total: f64 = experience.steps.iter().map(|step| step.reward).sum();
        let termination = self.learner.termination;
        self.record.curve.push(Point {
            steps: self.record.tally.steps,
            mean_return: total / rollouts,
            mean_length: experience.steps.len() as f64 / rollouts,
            actions: 1.0 / termination.probability(),
            continuations: termination.continuations(),
        });
    }

    /// What came of it.
    pub fn finish(self) -> Learned {
        let normalizer = self.normalizer();
        let Learner { policies, interests, termination, .. } = self.learner;
        let network = |network| NormalizedMlp::new(normalizer.clone(), network);
        let option = |(policy, interest): (Policy, Net)| InterestPolicy {
            means: network(policy.means.network),
            log_std: policy.log_std,
            log_interest: network(interest.network),
            ending: termination.probability() as f32,
        };
        Learned {
            options: policies.into_iter().zip(interests).map(option).collect(),
            curve: self.record.curve,
        }
    }
}

/// What the gradient steps of one iteration are driven by, per step.
pub(super) struct Signals {
    /// `A_action`, scaled to deviation 1 and weighted.
    pub actions: Vec<f32>,
    /// `A_draw` likewise, over the steps where an option was drawn; 0 elsewhere.
    pub draws: Vec<f32>,
    /// What the critic should have said.
    pub targets: Vec<f32>,
}

impl Signals {
    /// Of an iteration whose steps count `weights`.
    pub fn new(experience: &Experience, weights: &[f64]) -> Self {
        let Experience { steps, advantages, .. } = experience;
        let mut actions: Vec<f32> = advantages.iter().map(|a| a.action as f32).collect();
        normalize(&mut actions);
        let drawn = || (0..steps.len()).filter(|&row| steps[row].drawn);
        let mut scaled: Vec<f32> = drawn().map(|row| advantages[row].draw as f32).collect();
        normalize(&mut scaled);
        let mut draws = vec![0.0; steps.len()];
        drawn().zip(scaled).for_each(|(row, advantage)| draws[row] = advantage);
        for signal in [&mut actions, &mut draws] {
            signal.iter_mut().zip(weights).for_each(|(s, w)| *s *= *w as f32);
        }
        let target = |(step, advantages)| value_target(step, advantages) as f32;
        Self { actions, draws, targets: steps.iter().zip(advantages).map(target).collect() }
    }
}
