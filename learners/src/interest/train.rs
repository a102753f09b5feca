//! The training, from top to bottom: roll out the infant agent, estimate advantages, improve the policies, the interests
//! and `ε`, and the critic.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};

use elo_core::context::Context;
use elo_core::policy::{Monitor, OptionLearner as _, Practice, TrainError};
use elo_core::simulator::Simulator;
use elo_core::spec::SimulatorSpec;
use elo_core::task::{Range, Task};
use rand::RngExt as _;
use rand::seq::SliceRandom as _;
use serde::{Deserialize, Serialize};

use super::advantages::{Advantages, advantages, value_target};
use super::batch::{self, Batch};
use super::config::InterestConfig;
use super::duration::{Termination, clipped_end};
use super::imitation;
use super::learner::{Learner, Net, Policy};
use super::policy::InterestPolicy;
use super::practice::{Episode, Experience, Infant, Rollout};
use super::risk;
use super::valuation;
use crate::acting::{Tally, draw_contexts};
use crate::fields::refuse_faults;
use crate::kernels::clipped_surrogate::typical_kl;
use crate::kernels::gae::normalize;
use crate::kernels::running_moments::{Normalizer, ReturnScaler, RunningMoments};
use crate::nn::Scratch;
use crate::normalized_mlp::NormalizedMlp;
use crate::parallel::in_order;

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
    /// Mean number of continuations of the options, `ρ = (1 − ε)/ε`, where no rollout ends before; they act once more.
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
    let mut training = Training::new(config, practice, monitor)?;
    match monitor.resume() {
        Some(bytes) => training.restore(&bytes)?,
        None => training.imitate()?,
    }
    while training.goes_on() {
        let before = training.record.tally.steps;
        training.iterate(monitor)?;
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
    /// One for each thread.
    simulators: Vec<Box<dyn Simulator>>,
    /// Where rollouts begin and for what, and how the critic sees the task.
    contexts: Vec<(Context, Vec<f32>)>,
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
    /// How the networks saw observations in the last iteration.
    normalizer: Normalizer,
    /// Scale of the rewards.
    scaler: ReturnScaler,
    /// Counts.
    tally: Tally,
    /// One point an iteration.
    curve: Vec<Point>,
}

impl<'a> Training<'a> {
    /// Before the first iteration.
    pub fn new(
        config: &'a InterestConfig,
        practice: &'a Practice<'a>,
        monitor: &mut dyn Monitor,
    ) -> Result<Self, TrainError> {
        refuse_faults(|faults| config.validate(faults)).map_err(TrainError::Other)?;
        let simulators = (0..monitor.threads().max(1)).map(|_| practice.simulator.build());
        let mut simulators = simulators.collect::<Result<Vec<_>, _>>()?;
        let spec = simulators[0].spec().clone();
        let seed = practice.seed.child("contexts");
        let tasks = (0..config.context_pool)
            .map(|index| practice.tasks.draw(&mut seed.child("task").index(index).stream()));
        let contexts = draw_contexts(
            practice.initial_states,
            simulators[0].as_mut(),
            tasks,
            &seed.child("start"),
            &mut || monitor.progress(0, config.steps),
        )?;
        let with_features = |context: Context| {
            let features = task_features(&context.task, practice, &spec);
            (context, features)
        };
        let scale = imitation::scale(config, practice, &spec)?;
        Ok(Self {
            contexts: contexts.into_iter().map(with_features).collect(),
            learner: Learner::new(config, practice, &spec),
            record: Record {
                iteration: 0,
                moments: RunningMoments::new(spec.observation_size),
                normalizer: scale.clone().unwrap_or_else(|| Normalizer::identity(spec.observation_size)),
                scaler: ReturnScaler::new(1, config.discount.gamma),
                tally: Tally::default(),
                curve: Vec::new(),
            },
            scale,
            config,
            practice,
            simulators,
        })
    }

    /// Lets the options begin from recordings, if they are to.
    fn imitate(&mut self) -> Result<(), TrainError> {
        let Self { learner, practice, scale, .. } = self;
        scale.as_ref().map_or(Ok(()), |scale| imitation::imitate(learner, practice, scale))
    }

    /// Whether not all steps have been taken.
    pub fn goes_on(&self) -> bool {
        self.record.tally.steps < self.config.steps
    }

    /// One improvement, `θ_k → θ_{k+1}`.
    pub fn iterate(&mut self, monitor: &mut dyn Monitor) -> Result<(), TrainError> {
        let mut experience = self.collect(monitor)?;
        self.log(&experience);
        let poor = risk::poor(&experience, self.config.risk, self.practice.horizon.discount);
        self.scale_rewards(&mut experience);
        let estimates = self.estimate(&experience, poor.as_deref());
        let moved = self.improve(&experience, &estimates);
        moved
            .and_then(|kl| self.learner.divergence(kl).map_or(Ok(()), Err))
            .map_err(|reason| TrainError::Diverged { steps: self.record.tally.steps, reason })?;
        self.record.iteration += 1;
        Ok(())
    }

    /// Rolls out the infant agent in contexts of the pool. The monitor hears of each rollout.
    pub fn collect(&mut self, monitor: &mut dyn Monitor) -> Result<Experience, TrainError> {
        let Self { config, practice, simulators, contexts, scale, learner, record } = self;
        let seed = practice.seed.child("rollouts").index(record.iteration);
        let before = record.tally.steps;
        let left = config.steps - before;
        // What is left, divided evenly.
        let wanted = left.div_ceil(left.div_ceil(config.rollout_steps));
        if scale.is_none() {
            record.normalizer = record.moments.normalizer();
        }
        let Record { moments, normalizer, tally, .. } = record;
        let done = AtomicU64::new(0);
        let roll_out = |simulator: &mut Box<dyn Simulator>, rollout: u64| {
            let seed = seed.index(rollout);
            let which = seed.child("context").stream().random_range(0..contexts.len());
            let (context, features) = &contexts[which];
            let episode = Episode {
                context,
                features,
                horizon: &practice.horizon,
                // Of what other threads are at nothing is known yet: then there are steps too many.
                max_steps: (left - done.load(Ordering::Relaxed)).min(practice.horizon.steps as u64),
                gamma: config.discount.gamma,
            };
            let mut infant = Infant { learner, normalizer, scratch: Scratch::default() };
            infant.roll_out(simulator.as_mut(), &episode, &mut seed.child("noise").stream())
        };
        let mut experience = Experience::default();
        // Those that fail without a step are few, or else end the training.
        in_order(simulators, roll_out, |Rollout { experience: mut more, moments: seen, failure }| {
            let allowed = left - done.load(Ordering::Relaxed);
            more.truncate(allowed as usize);
            tally.episodes += 1;
            if let Some(error) = failure.filter(|_| (more.steps.len() as u64) < allowed)
                && let Err(error) = tally.fail(&error)
            {
                return ControlFlow::Break(Err(error));
            }
            moments.merge(&seen);
            experience.append(more);
            let taken = experience.steps.len() as u64;
            done.store(taken, Ordering::Relaxed);
            match monitor.progress(before + taken, config.steps) {
                Err(stopped) => ControlFlow::Break(Err(stopped.into())),
                Ok(()) if taken >= wanted => ControlFlow::Break(Ok(())),
                Ok(()) => ControlFlow::Continue(()),
            }
        })?;
        tally.steps += experience.steps.len() as u64;
        Ok(experience)
    }

    /// Divides rewards by the deviation of the discounted returns seen so far.
    fn scale_rewards(&mut self, experience: &mut Experience) {
        for step in &experience.steps {
            self.record.scaler.scale(0, step.reward);
            if step.last {
                self.record.scaler.end_episode(0);
            }
        }
        let factor = self.record.scaler.factor();
        experience.steps.iter_mut().for_each(|step| step.reward *= factor);
    }

    /// What the critic that saw the steps makes of them, and what `poor` rollouts cost, if any cost something.
    pub fn estimate(&mut self, experience: &Experience, poor: Option<&[f64]>) -> Estimates {
        let config = self.config;
        let termination = self.learner.termination;
        let steps = valuation::value(&mut self.learner, experience);
        let mut all = vec![Advantages::default(); steps.len()];
        advantages(&steps, termination, config.discount.into(), &mut all);
        let targets = steps.iter().zip(&all).map(|(step, a)| value_target(step, a) as f32).collect();

        // In a mean over steps, decisions of `J` count `γ^t / mean_discount`, or all alike in its place.
        let mean_discount = experience.discounts.iter().sum::<f64>() / steps.len() as f64;
        for (advantages, discount) in all.iter_mut().zip(&experience.discounts) {
            let weight = if config.discounted_visits { discount / mean_discount } else { 1.0 };
            advantages.action *= weight;
            advantages.draw *= weight;
            advantages.end *= config.discount.gamma * weight;
        }
        if let Some(prices) = poor {
            let prices: Vec<f64> = prices.iter().map(|price| price / mean_discount).collect();
            risk::charge(&mut all, &steps, &prices, termination);
        }
        Estimates {
            advantages: all,
            targets,
            visits: mean_discount * steps.len() as f64 / experience.rollouts(),
        }
    }

    /// Epochs of gradient steps on shuffled minibatches, and after each one on `ε`. Returns how far decisions have moved, in nats;
    /// the error says why it cannot go on.
    fn improve(&mut self, experience: &Experience, estimates: &Estimates) -> Result<f32, String> {
        let config = self.config;
        let rates = config.rates(self.record.tally.steps - experience.steps.len() as u64);
        let worth = estimates.worth_of_ending();
        let signals = Signals::new(experience, estimates);
        let before = self.learner.termination;
        let count = experience.steps.len();
        let mut order: Vec<usize> = (0..count).collect();
        let cuts = cuts(count, config.minibatch);
        let mut shuffler = self.practice.seed.child("shuffle").index(self.record.iteration).stream();
        let mut kl = 0.0;
        for _ in 0..config.epochs {
            order.shuffle(&mut shuffler);
            let usage = batch::usage(config, experience, &mut self.learner);
            let mut moved = Vec::with_capacity(cuts.len());
            for cut in cuts.windows(2) {
                let rows = &order[cut[0]..cut[1]];
                let batch = Batch { config, experience, signals: &signals, usage: usage.as_deref(), rows };
                moved.push(batch.differentiate(&mut self.learner));
                self.learner.descend(rates, config.max_grad_norm)?;
            }
            let gradient = self.termination_gradient(before, worth);
            if !gradient.is_finite() {
                return Err(format!("the gradient of the termination probability is {gradient}"));
            }
            self.learner.ascend_termination(gradient, rates.termination);
            kl = typical_kl(moved);
            if f64::from(kl) >= config.target_kl {
                break;
            }
        }
        Ok(kl)
    }

    /// `dJ/dx = ε(1 − ε) dV/dε − λ dφ/dx`, the first part clipped; `worth` is `dV/dε`.
    pub fn termination_gradient(&self, before: Termination, worth: f64) -> f64 {
        let InterestConfig { continuations, duration_weight, clip, .. } = self.config;
        let now = self.learner.termination;
        clipped_end(now, before, worth, *clip) - duration_weight * continuations.d_cost(now)
    }

    fn log(&mut self, experience: &Experience) {
        let rollouts = experience.rollouts();
        let total: f64 = experience.steps.iter().map(|step| step.reward).sum();
        self.record.curve.push(Point {
            steps: self.record.tally.steps,
            mean_return: total / rollouts,
            mean_length: experience.steps.len() as f64 / rollouts,
            continuations: self.learner.termination.continuations(),
        });
    }

    /// What came of it.
    pub fn finish(self) -> Learned {
        let normalizer = self.record.normalizer;
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

/// Where `count` steps are cut into minibatches, as many as `size` fits in: their sizes differ by one at most, so that none is a
/// handful of steps.
fn cuts(count: usize, size: usize) -> Vec<usize> {
    let batches = (count / size).max(1);
    (0..=batches).map(|batch| batch * count / batches).collect()
}

/// The parameters that `P` draws, each from −1 to 1 over its range in `P`.
fn task_features(task: &Task, practice: &Practice<'_>, spec: &SimulatorSpec) -> Vec<f32> {
    let feature = |(name, Range { low, high }): (&str, Range)| {
        let from_middle = spec.parameter_value(task, name) - 0.5 * (low + high);
        if high > low { (2.0 * from_middle / (high - low)) as f32 } else { 0.0 }
    };
    practice.tasks.ranges().map(feature).collect()
}

/// What an iteration's steps say of the decisions in them.
pub(super) struct Estimates {
    /// Of each step's decisions, times what the step counts, with the price of risk.
    pub advantages: Vec<Advantages>,
    /// What the critic should have said of each step.
    pub targets: Vec<f32>,
    /// The sum of `γ^t` in a rollout, on average.
    pub visits: f64,
}

impl Estimates {
    /// `dV/dε`: what ending is worth in the mean over steps, times the sum of `γ^t` in a rollout.
    pub fn worth_of_ending(&self) -> f64 {
        let ends: f64 = self.advantages.iter().map(|advantages| advantages.end).sum();
        self.visits * ends / self.advantages.len() as f64
    }
}

/// What the gradient steps of one iteration are driven by, per step.
pub(super) struct Signals<'a> {
    /// `A_action`, scaled to deviation 1.
    pub actions: Vec<f32>,
    /// `A_draw` likewise, over the steps where an option was drawn; 0 elsewhere.
    pub draws: Vec<f32>,
    /// What the critic should have said.
    pub targets: &'a [f32],
}

impl<'a> Signals<'a> {
    /// Of an iteration.
    pub fn new(experience: &Experience, estimates: &'a Estimates) -> Self {
        let Estimates { advantages, targets, .. } = estimates;
        let mut actions: Vec<f32> = advantages.iter().map(|a| a.action as f32).collect();
        normalize(&mut actions);
        let mut scaled: Vec<f32> = experience.drawn().map(|row| advantages[row].draw as f32).collect();
        normalize(&mut scaled);
        let mut draws = vec![0.0; advantages.len()];
        experience.drawn().zip(scaled).for_each(|(row, advantage)| draws[row] = advantage);
        Self { actions, draws, targets }
    }
}

#[cfg(test)]
mod tests {
    use elo_core::context::InitialStates;
    use elo_core::policy::Unwatched;
    use elo_core::simulator::SimulatorConfig as _;
    use elo_core::task::TaskDistribution;

    use super::super::config::{Discounts, LearningRates};
    use super::super::worlds::{World, practice};
    use super::*;

    #[test]
    fn the_critic_sees_a_task_by_its_place_in_p() {
        // The simulator allows 0 to 2.
        let tasks = TaskDistribution::new([("pay", Range { low: 0.5, high: 0.9 })]);
        let initial_states = InitialStates::default();
        let practice = practice(&World::Hot, &tasks, &initial_states, 5, 1);
        let spec = World::Hot.spec().expect("a world has a spec");
        for (pay, expected) in [(0.5, -1.0), (0.6, -0.5), (0.7, 0.0), (0.9, 1.0)] {
            let [seen] = task_features(&Task::new([("pay", pay)]), &practice, &spec)[..] else { panic!() };
            assert!((seen - expected).abs() < 1e-6, "{pay}: {seen}");
        }
    }

    #[test]
    fn minibatches_differ_by_one_step_at_most() {
        for (count, size) in [(8193, 64), (8391, 256), (64, 64), (63, 64), (1, 256), (130, 64)] {
            let cuts = cuts(count, size);
            let sizes: Vec<usize> = cuts.windows(2).map(|cut| cut[1] - cut[0]).collect();
            assert_eq!((sizes.iter().sum::<usize>(), sizes.len()), (count, (count / size).max(1)));
            let (least, most) = (sizes.iter().min(), sizes.iter().max());
            assert!(
                most.zip(least).is_some_and(|(most, least)| most - least <= 1),
                "{count} by {size}: {sizes:?}"
            );
        }
    }
    /// What the critic thinks of the only state, in unscaled rewards of 1 a step on average, with γ = 0.9.
    fn valued(world: World, steps: usize) -> f64 {
        let config = InterestConfig {
            steps: 30_000,
            rollout_steps: 300,
            context_pool: 500,
            minibatch: 50,
            learning_rates: LearningRates { critic: 3e-3, ..LearningRates::default() },
            discount: Discounts { gamma: 0.9, gae_lambda: 0.95 },
            hidden: vec![8],
            ..InterestConfig::default()
        };
        let tasks = TaskDistribution::new([("pay", Range { low: 1.0, high: 1.0 })]);
        let initial_states = InitialStates { max_random_steps: 0, ..InitialStates::default() };
        let practice = practice(&world, &tasks, &initial_states, steps, 1);
        let mut training = Training::new(&config, &practice, &mut Unwatched).expect("a valid training");
        while training.goes_on() {
            training.iterate(&mut Unwatched).expect("a training that ends");
        }
        let values = training.learner.critic.forward(&[0.0; 3]).to_vec();
        values.iter().map(|q| f64::from(*q)).sum::<f64>() / 2.0 / training.record.scaler.factor()
    }

    #[test]
    fn a_time_limit_is_not_death_to_the_critic_and_a_fall_is() {
        // Who is cut short after five steps would have earned 1 + γ + γ² + … = 10 from any of them on; were the cut taken for an
        // end, it would be 2.6 on average. After a fall nothing comes; were it taken for a cut, it would be 10.
        let (cut, fallen) = (valued(World::Endless, 5), valued(World::Fatal, 5));
        assert!((cut - 10.0).abs() < 1.0, "{cut}");
        assert!((fallen - 1.0).abs() < 0.2, "{fallen}");
    }
}
