//! What training comes to in worlds where the best options are known.

#![allow(clippy::unwrap_used)]

use elo_core::agent::{Agent as _, InfantAgent};
use elo_core::context::InitialStates;
use elo_core::policy::{Demonstration, Monitor, OptionPolicy, PolicyRecord, Practice, Stopped, Unwatched};
use elo_core::seed::{Seed, Stream};
use elo_core::simulator::{SimulatorConfig as _, Start};
use elo_core::task::{Range, Task, TaskDistribution};

use super::config::{Discounts, InterestConfig, LearningRates};
use super::duration::Band;
use super::learner::Learner;
use super::policy::InterestPolicy;
use super::risk::Risk;
use super::train::{Learned, Training, train};
use super::worlds::{World, practice};

/// Of a rollout.
const STEPS: usize = 64;

/// Eight rollouts.
const ITERATION: u64 = 8 * STEPS as u64;

/// Networks that are tables: without hidden layers, of observations with one 1.
fn tables() -> InterestConfig {
    InterestConfig {
        duration_weight: 0.0,
        initial_continuations: 3.0,
        steps: 150 * ITERATION,
        rollout_steps: ITERATION,
        context_pool: 50,
        epochs: 4,
        minibatch: 128,
        learning_rates: LearningRates { policies: 0.0, interests: 0.03, termination: 0.03, critic: 0.03 },
        discount: Discounts { gamma: 0.9, gae_lambda: 0.9 },
        hidden: Vec::new(),
        initial_log_std: -2.0,
        ..InterestConfig::default()
    }
}

fn pays() -> TaskDistribution {
    TaskDistribution::new([("pay", Range { low: 0.5, high: 1.5 })])
}

fn at_once() -> InitialStates {
    InitialStates { max_random_steps: 0, ..InitialStates::default() }
}

/// Trains in `world`, with a learner that `prepare` has changed first.
fn trained(config: &InterestConfig, world: World, seed: u64, prepare: impl Fn(&mut Learner)) -> Learned {
    trained_for(STEPS, config, world, seed, prepare)
}

/// The same for rollouts of `steps`.
fn trained_for(
    steps: usize,
    config: &InterestConfig,
    world: World,
    seed: u64,
    prepare: impl Fn(&mut Learner),
) -> Learned {
    let (tasks, initial_states) = (pays(), at_once());
    let practice = practice(&world, &tasks, &initial_states, steps, seed);
    let mut training = Training::new(config, &practice, &mut Unwatched).unwrap();
    prepare(&mut training.learner);
    while training.goes_on() {
        training.iterate(&mut Unwatched).unwrap();
    }
    training.finish()
}

/// Option 0 always goes on, option 1 always pulls back.
fn reflexes(learner: &mut Learner) {
    for (policy, sign) in learner.policies.iter_mut().zip([1.0, -1.0]) {
        policy.means.network.params_mut().copy_from_slice(&[0.0, 0.0, sign]);
    }
}

/// Option 0 is preferred in state 0, option 1 in state 1, by `e^6` to 1.
fn sure_interests(learner: &mut Learner) {
    for (interest, sign) in learner.interests.iter_mut().zip([3.0, -3.0]) {
        interest.network.params_mut().copy_from_slice(&[sign, -sign, 0.0]);
    }
}

/// The infant agent's mean reward a step, in the task that pays 1; and its actions.
fn played(learned: &Learned, world: World, steps: u64) -> (f64, Vec<f32>) {
    let options: Vec<&dyn OptionPolicy> = learned.options.iter().map(|option| option as _).collect();
    played_by(&options, world, steps)
}

fn played_by(options: &[&dyn OptionPolicy], world: World, steps: u64) -> (f64, Vec<f32>) {
    let mut simulator = world.build().unwrap();
    let mut agent = InfantAgent::new(options, &world.spec().unwrap());
    let mut noise = Seed::root(77).stream();
    let (mut observation, mut action, mut terms) = ([0.0; 2], [0.0], [0.0]);
    simulator.reset(&Task::default(), &Start::Seed(5), &mut observation).unwrap();
    agent.begin(&observation, &mut noise);
    let (mut total, mut actions) = (0.0, Vec::new());
    for _ in 0..steps {
        agent.act(&observation, &mut noise, &mut action);
        simulator.step(&action, &mut observation, &mut terms).unwrap();
        total += terms[0];
        actions.push(action[0]);
    }
    (total / steps as f64, actions)
}

/// An option without an initiation set, otherwise as the one within.
#[derive(Debug)]
struct Anywhere<'a>(&'a InterestPolicy);

impl OptionPolicy for Anywhere<'_> {
    fn act(&self, observation: &[f32], elapsed: usize, noise: &mut Stream, action: &mut [f32]) {
        self.0.act(observation, elapsed, noise, action);
    }
    fn termination(&self, observation: &[f32], elapsed: usize) -> f64 {
        self.0.termination(observation, elapsed)
    }
    fn record(&self) -> PolicyRecord {
        self.0.record()
    }
}

/// `I_0 / I_1` in both states.
fn interest_ratios(learned: &Learned) -> [f32; 2] {
    [[1.0, 0.0], [0.0, 1.0]]
        .map(|seen| learned.options[0].interest(&seen) / learned.options[1].interest(&seen))
}

#[test]
fn interests_tell_a_hot_surface_from_elsewhere() {
    for seed in [1, 2, 3] {
        let learned = trained(&tables(), World::Hot, seed, reflexes);
        let [elsewhere, touching] = interest_ratios(&learned);
        let (reward, _) = played(&learned, World::Hot, 20_000);
        assert!(
            elsewhere >= 10.0 && touching <= 0.1,
            "seed {seed}: {elsewhere} elsewhere, {touching} touching"
        );
        assert!(reward >= 0.95, "seed {seed}: {reward}");
    }
}

#[test]
fn everything_learned_at_once_is_as_good() {
    let config = InterestConfig {
        learning_rates: LearningRates { policies: 0.03, ..tables().learning_rates },
        initial_log_std: -0.5,
        ..tables()
    };
    for seed in [1, 2, 3] {
        let learned = trained(&config, World::Hot, seed, |_| {});
        let (reward, _) = played(&learned, World::Hot, 20_000);
        assert!(reward >= 0.95, "seed {seed}: {reward}");
    }
}

#[test]
fn duration_follows_what_pays() {
    let config = InterestConfig { steps: 60 * ITERATION, ..tables() };
    let interests_held = InterestConfig {
        learning_rates: LearningRates { interests: 0.0, ..config.learning_rates },
        ..config
    };
    for seed in [1, 2, 3] {
        let long = trained(&interests_held, World::Steady, seed, reflexes).curve;
        let short = trained(&interests_held, World::Fickle, seed, |learner| {
            reflexes(learner);
            sure_interests(learner);
        })
        .curve;
        assert!(long[59].continuations > 3.0 * long[0].continuations, "seed {seed}: {:?}", long[59]);
        assert!(short[59].continuations < short[0].continuations / 3.0, "seed {seed}: {:?}", short[59]);
        assert!(long[59].mean_return > long[0].mean_return && short[59].mean_return > short[0].mean_return);
    }
}

#[test]
fn a_heavy_duration_cost_is_obeyed() {
    let within = |continuations: Band, expected: f64| {
        let config = InterestConfig { continuations, duration_weight: 100.0, ..tables() };
        for world in [World::Steady, World::Fickle] {
            let got = trained(&config, world, 1, reflexes).curve[149].continuations;
            assert!((got / expected - 1.0).abs() < 0.05, "{continuations:?} in {world:?}: {got}");
        }
    };
    within(Band { low: 8.0, high: 8.0 }, 8.0);
    within(Band { low: 1.5, high: 1.5 }, 1.5);
}

#[test]
fn options_last_as_long_as_their_termination_says() {
    let config = InterestConfig {
        learning_rates: LearningRates { policies: 0.0, interests: 0.0, termination: 0.0, critic: 0.0 },
        initial_continuations: 4.0,
        steps: 40_000,
        rollout_steps: 40_000,
        ..tables()
    };
    let (tasks, initial_states) = (pays(), at_once());
    let practice = practice(&World::Steady, &tasks, &initial_states, 40_000, 1);
    let steps =
        Training::new(&config, &practice, &mut Unwatched).unwrap().collect(&mut Unwatched).unwrap().steps;
    // Options in practice, the last of which may not have ended: geometric with mean 1/ε = 5 and deviation √(1 − ε)/ε = 4.5.
    let lengths: Vec<usize> = {
        let begins: Vec<usize> = (0..steps.len()).filter(|&row| steps[row].drawn).collect();
        begins.windows(2).map(|pair| pair[1] - pair[0]).collect()
    };
    let mean = |of: &dyn Fn(usize) -> f64| {
        lengths.iter().map(|&length| of(length)).sum::<f64>() / lengths.len() as f64
    };
    let error = 4.5 / (lengths.len() as f64).sqrt();
    let (executed, continued) = (mean(&|length| length as f64), mean(&|length| (length - 1) as f64));
    assert!((executed - 5.0).abs() < 4.0 * error && (continued - 4.0).abs() < 4.0 * error, "{executed}");

    // With interests held, the other option is drawn in half of the draws: a run of one sign is a geometric number of
    // options with mean 2, so of actions with mean 2/ε = 10 and deviation √(1 − ε/2)/(ε/2) = 9.5.
    let learned = trained(&config, World::Steady, 1, reflexes);
    let (_, actions) = played(&learned, World::Steady, 100_000);
    let changes = actions.windows(2).filter(|pair| (pair[0] > 0.0) != (pair[1] > 0.0)).count() as f64;
    let mean = 100_000.0 / (changes + 1.0);
    assert!((mean - 10.0).abs() < 4.0 * 9.5 / changes.sqrt(), "{mean}");
}

#[test]
fn interests_that_are_not_learned_are_those_of_the_uniform_agent() {
    let rates = LearningRates { interests: 0.0, policies: 0.03, ..tables().learning_rates };
    let config = InterestConfig { learning_rates: rates, steps: 5 * ITERATION, hidden: vec![4], ..tables() };
    let played_anywhere = |learned: &Learned| {
        let anywhere: Vec<Anywhere<'_>> = learned.options.iter().map(Anywhere).collect();
        let anywhere: Vec<&dyn OptionPolicy> = anywhere.iter().map(|option| option as _).collect();
        played_by(&anywhere, World::Hot, 1000)
    };
    let learned = trained(&config, World::Hot, 1, |_| {});
    assert_eq!(played(&learned, World::Hot, 1000), played_anywhere(&learned));
    // Learned ones make another agent.
    let rates = LearningRates { interests: 0.03, ..rates };
    let learned = trained(&InterestConfig { learning_rates: rates, ..config }, World::Hot, 1, |_| {});
    assert_ne!(played(&learned, World::Hot, 1000), played_anywhere(&learned));
}

#[test]
fn a_price_on_poor_returns_turns_from_the_gamble() {
    let config = InterestConfig {
        steps: 60 * 640,
        rollout_steps: 640,
        learning_rates: LearningRates { termination: 0.0, ..tables().learning_rates },
        initial_continuations: 9.0,
        // The world's luck is the start's.
        context_pool: 5000,
        ..tables()
    };
    let share_of_the_gamble = |risk: Risk, seed: u64| {
        let config = InterestConfig { risk, ..config.clone() };
        let [ratio, _] = interest_ratios(&trained_for(10, &config, World::Gamble, seed, reflexes));
        ratio / (1.0 + ratio)
    };
    for seed in [1, 2, 3] {
        let (mean, averse) = (
            share_of_the_gamble(Risk::Mean, seed),
            share_of_the_gamble(Risk::NegativeTail { k: 5.0, alpha: 1.0 }, seed),
        );
        assert!(mean > 0.6 && averse < 0.4, "seed {seed}: {mean} for the mean, {averse} with the price");
    }
}

#[test]
fn passes_end_once_decisions_have_moved() {
    let learn = |epochs: usize, target_kl: f64| {
        let config = InterestConfig { epochs, target_kl, steps: 3 * ITERATION, hidden: vec![8], ..tables() };
        trained(&config, World::Hot, 1, |_| {})
    };
    assert_eq!(learn(4, 1e-9), learn(1, 1000.0));
    assert_ne!(learn(4, 1000.0), learn(1, 1000.0));
}

#[test]
fn diversity_keeps_all_options_in_use() {
    let least_share = |diversity_weight: f64, seed: u64| {
        let config = InterestConfig {
            learning_rates: LearningRates { policies: 0.03, ..tables().learning_rates },
            initial_log_std: -0.5,
            diversity_weight,
            ..tables()
        };
        let learned = trained(&config, World::Hot, seed, |_| {});
        let (reward, _) = played(&learned, World::Hot, 20_000);
        assert!(reward >= 0.95, "seed {seed}: {reward}");
        let shares = interest_ratios(&learned).map(|ratio| f64::from(ratio / (1.0 + ratio)));
        // Elsewhere and touching, as often as the best policy is there.
        let first = (shares[0] + 0.3 * shares[1]) / 1.3;
        first.min(1.0 - first)
    };
    let seeds = [1, 2, 3];
    let (with, without) =
        (seeds.map(|seed| least_share(0.5, seed)), seeds.map(|seed| least_share(0.0, seed)));
    assert!(with.iter().all(|share| *share > 0.2), "{with:?}");
    assert!(without.iter().any(|share| *share < 0.1), "{without:?}");
}

#[test]
fn options_begin_as_clones_of_recordings() {
    let recording = Demonstration {
        observations: [[1.0, 0.0], [0.0, 1.0]].repeat(20).concat(),
        actions: [[0.8], [-0.6]].repeat(20).concat(),
        steps: 40,
    };
    let config = InterestConfig {
        imitation_start: true,
        steps: ITERATION,
        learning_rates: LearningRates { policies: 0.0, interests: 0.0, termination: 0.0, critic: 0.0 },
        ..tables()
    };
    let (tasks, initial_states, recordings) = (pays(), at_once(), [recording]);
    let practice = practice(&World::Hot, &tasks, &initial_states, STEPS, 1);
    let practice = Practice { demonstrations: &recordings, ..practice };
    let answers = |config: &InterestConfig| {
        let learned = train(config, &practice, &mut Unwatched).unwrap();
        [[1.0, 0.0], [0.0, 1.0]].map(|seen| {
            [0, 1].map(|option| {
                let mut mean = [0.0];
                learned.options[option].means.evaluate(&seen, &mut mean);
                mean[0]
            })
        })
    };
    // The second option has no recording.
    let [[forward, other], [back, another]] = answers(&config);
    assert!((forward - 0.8).abs() < 0.1 && (back + 0.6).abs() < 0.1, "{forward} {back}");
    assert!(other.abs() < 0.1 && another.abs() < 0.1, "{other} {another}");
    let [[forward, _], [back, _]] = answers(&InterestConfig { imitation_start: false, ..config.clone() });
    assert!(forward.abs() < 0.1 && back.abs() < 0.1, "{forward} {back}");
}

/// Allows so many threads.
struct Threads(usize);

impl Monitor for Threads {
    fn resume(&mut self) -> Option<Vec<u8>> {
        None
    }
    fn checkpoint(&mut self, _: &[u8]) -> Result<(), Stopped> {
        Ok(())
    }
    fn progress(&mut self, _: u64, _: u64) -> Result<(), Stopped> {
        Ok(())
    }
    fn threads(&self) -> usize {
        self.0
    }
}

#[test]
fn any_number_of_threads_learns_the_same_set() {
    // Rollouts of 64 steps, so that the last one is cut short and others are begun in vain.
    let config = InterestConfig { steps: 3 * ITERATION + 21, hidden: vec![8], ..tables() };
    let (world, tasks, initial_states) = (World::Hot, pays(), at_once());
    let practice = practice(&world, &tasks, &initial_states, STEPS, 1);
    let learn = |threads| {
        let mut training = Training::new(&config, &practice, &mut Threads(threads)).unwrap();
        while training.goes_on() {
            training.iterate(&mut Unwatched).unwrap();
        }
        training.finish()
    };
    let alone = learn(1);
    assert_eq!(alone.curve.last().unwrap().steps, config.steps);
    for threads in [2, 5] {
        assert_eq!(learn(threads), alone, "{threads} threads");
    }
}

#[test]
fn the_same_seed_learns_the_same_set() {
    let config = InterestConfig { steps: 3 * ITERATION, hidden: vec![8], ..tables() };
    let (world, tasks, initial_states) = (World::Hot, pays(), at_once());
    let learn = |seed| {
        let practice = practice(&world, &tasks, &initial_states, STEPS, seed);
        train(&config, &practice, &mut Unwatched).unwrap().options
    };
    assert_eq!(learn(1), learn(1));
    assert_ne!(learn(1), learn(2));
}
