//! Where a teacher practises: one simulator, one episode after another.

use elo_core::context::PreparedStart;
use elo_core::policy::TrainError;
use elo_core::rollout::price;
use elo_core::seed::Seed;
use elo_core::simulator::{End, Simulator, Start, State, check_finite};
use elo_core::task::Task;
use rand::RngExt as _;
use serde::{Deserialize, Serialize};

use crate::acting::Tally;

/// What all environments of a training have in common.
#[derive(Clone, Debug)]
pub(super) struct Course<'a> {
    /// The task that every episode is an instance of.
    pub task: &'a Task,
    /// What the task pays for one unit of each reward term.
    pub prices: Vec<f64>,
    /// Starts drawn from `d0`; may be empty when `d0_share` is 0.
    pub d0: Vec<PreparedStart>,
    /// Share of the episodes that begin at one of them.
    pub d0_share: f64,
    /// Time limit of an episode.
    pub max_episode_steps: u64,
    /// The root of what the episodes draw.
    pub seed: Seed,
}

impl Course<'_> {
    /// The start of one environment's episode, counted from 0.
    fn start(&self, environment: u64, episode: u64) -> PreparedStart {
        let seed = self.seed.index(environment).index(episode);
        let mut stream = seed.stream();
        if stream.random::<f64>() < self.d0_share {
            self.d0[stream.random_range(0..self.d0.len())].clone()
        } else {
            PreparedStart::standard(seed.child("reset").number())
        }
    }
}

/// One environment's present episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Episode {
    /// Episodes that this environment has begun, with this one.
    pub number: u64,
    /// Control steps so far.
    pub steps: u64,
    /// Sum of the rewards so far.
    pub total: f64,
}

/// An environment that was put down.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AtRest {
    episode: Episode,
    /// Where it was; `None` where the simulator cannot tell, or before the first episode.
    state: Option<State>,
}

/// What came of an action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Outcome {
    /// The reward, and whether the episode ended with it, by itself or at the time limit.
    Step {
        /// In the task's units.
        reward: f64,
        /// A time limit truncates.
        end: End,
    },
    /// The simulator failed: the step did not take place, and the episode is over.
    Failed,
}

/// One simulator in the midst of an episode.
pub(super) struct Environment {
    index: u64,
    simulator: Box<dyn Simulator>,
    observation: Vec<f32>,
    /// The action that is taken.
    action: Vec<f32>,
    terms: Vec<f64>,
    episode: Episode,
}

impl Environment {
    /// Before its first episode; [`Self::take_up`] begins it.
    pub fn new(index: usize, simulator: Box<dyn Simulator>) -> Self {
        let (observation_size, terms) =
            (simulator.spec().observation_size, simulator.spec().reward_terms.len());
        let actions = simulator.spec().action_size();
        Self {
            index: index as u64,
            simulator,
            observation: vec![0.0; observation_size],
            action: vec![0.0; actions],
            terms: vec![0.0; terms],
            episode: Episode::default(),
        }
    }

    /// What is seen now.
    pub fn observation(&self) -> &[f32] {
        &self.observation
    }

    /// The present episode, or the one that has just ended.
    pub fn episode(&self) -> &Episode {
        &self.episode
    }

    /// Begins the next episode that can be begun.
    ///
    /// # Errors
    /// As [`Tally::fail`].
    pub fn begin(&mut self, course: &Course<'_>, tally: &mut Tally) -> Result<(), TrainError> {
        loop {
            let start = course.start(self.index, self.episode.number);
            self.episode = Episode { number: self.episode.number + 1, steps: 0, total: 0.0 };
            tally.episodes += 1;
            let begun = start.begin(self.simulator.as_mut(), course.task, &mut self.observation);
            match begun.and_then(|()| check_finite(&self.observation, &[])) {
                Ok(()) => return Ok(()),
                Err(error) => tally.fail(&error)?,
            }
        }
    }

    /// Takes one control step. The action is clipped to its bounds first: what reaches no motor should cost nothing.
    ///
    /// # Errors
    /// As [`Tally::fail`].
    pub fn step(
        &mut self,
        action: &[f32],
        course: &Course<'_>,
        tally: &mut Tally,
    ) -> Result<Outcome, TrainError> {
        self.action.copy_from_slice(action);
        self.simulator.spec().clip(&mut self.action);
        let stepped = self.simulator.step(&self.action, &mut self.observation, &mut self.terms);
        let end = match stepped.and_then(|end| check_finite(&self.observation, &self.terms).map(|()| end)) {
            Ok(end) => end,
            Err(error) => return tally.fail(&error).map(|()| Outcome::Failed),
        };
        let reward = price(&self.terms, &course.prices);
        tally.steps += 1;
        self.episode.steps += 1;
        self.episode.total += reward;
        let out_of_time = end == End::Running && self.episode.steps >= course.max_episode_steps;
        Ok(Outcome::Step { reward, end: if out_of_time { End::Truncated } else { end } })
    }

    /// What a checkpoint keeps.
    pub fn put_down(&self) -> AtRest {
        let settable = self.simulator.spec().capabilities.settable_state;
        let state = if settable { self.simulator.state().ok() } else { None };
        AtRest { episode: self.episode.clone(), state }
    }

    /// Goes on with an episode that was put down, or begins the next where that is not possible. Tells whether the
    /// episode goes on.
    ///
    /// # Errors
    /// As [`Tally::fail`].
    pub fn take_up(
        &mut self,
        rest: &AtRest,
        course: &Course<'_>,
        tally: &mut Tally,
    ) -> Result<bool, TrainError> {
        self.episode = rest.episode.clone();
        if let Some(state) = &rest.state {
            let start = Start::State(state.clone());
            let reset = self.simulator.reset(course.task, &start, &mut self.observation);
            match reset.and_then(|()| check_finite(&self.observation, &[])) {
                Ok(()) => return Ok(true),
                Err(error) => tally.fail(&error)?,
            }
        }
        self.begin(course, tally).map(|()| false)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::{PointMassConfig, replay_only};
    use elo_core::context::InitialStates;
    use elo_core::simulator::SimulatorConfig as _;

    use super::*;
    use crate::acting::draw_contexts;

    fn course(task: &Task, d0_share: f64, max_episode_steps: u64) -> Course<'_> {
        let config = PointMassConfig::default();
        let mut simulator = config.build().unwrap();
        let tasks = std::iter::repeat_n(task.clone(), 20);
        let contexts =
            draw_contexts(&InitialStates::default(), simulator.as_mut(), tasks, &Seed::root(1), &mut || {
                Ok(())
            })
            .unwrap();
        assert_eq!(contexts.len(), 20);
        let d0 = contexts.into_iter().map(|context| context.start).collect();
        let prices = config.description().prices(task);
        Course { task, prices, d0, d0_share, max_episode_steps, seed: Seed::root(2) }
    }

    fn begun(simulator: Box<dyn Simulator>, course: &Course<'_>) -> Environment {
        let mut environment = Environment::new(0, simulator);
        let goes_on = environment.take_up(&AtRest::default(), course, &mut Tally::default()).unwrap();
        assert!(!goes_on);
        environment
    }

    #[test]
    fn the_share_of_episodes_from_d0_is_what_was_asked_for() {
        let task = Task::default();
        let count = |share| {
            let course = course(&task, share, 100);
            (0..2000).filter(|&n| matches!(course.start(n % 3, n).start, Start::State(_))).count()
        };
        assert_eq!(count(0.0), 0);
        assert_eq!(count(1.0), 2000);
        // Four standard deviations of a binomial count: 4·√(2000·0.3·0.7) = 82.
        assert!(count(0.3).abs_diff(600) < 82, "{}", count(0.3));
    }

    #[test]
    fn different_starts_of_the_pool_are_used() {
        let task = Task::default();
        let course = course(&task, 1.0, 100);
        let used = course.d0.iter().filter(|d0| (0..500).any(|n| course.start(0, n) == **d0)).count();
        assert_eq!(used, 20);
    }

    #[test]
    fn a_time_limit_truncates_and_a_wall_terminates() {
        let task = Task::default();
        let course = course(&task, 0.0, 5);
        let mut tally = Tally::default();
        let mut environment = begun(PointMassConfig::default().build().unwrap(), &course);
        let mut ends = |environment: &mut Environment, steps: usize| -> Vec<End> {
            let mut end_of = || match environment.step(&[1.0], &course, &mut tally).unwrap() {
                Outcome::Step { end, .. } => end,
                Outcome::Failed => panic!("the point mass does not fail"),
            };
            (0..steps).map(|_| end_of()).collect()
        };
        let running = End::Running;
        assert_eq!(ends(&mut environment, 5), [running, running, running, running, End::Truncated]);
        assert_eq!(environment.episode().steps, 5);
        // A wall 0.003 away: the first steps of a unit force move the mass by 0.0025, then 0.005.
        let near = PointMassConfig { wall: 0.003, reset_spread: 0.0 };
        let mut environment = begun(near.build().unwrap(), &course);
        assert_eq!(ends(&mut environment, 2), [running, End::Terminated]);
    }

    #[test]
    fn what_lies_beyond_an_action_bound_does_and_costs_nothing() {
        let task = Task::default();
        let course = course(&task, 0.0, 100);
        let stepped = |action: f32| {
            let mut environment = begun(PointMassConfig::default().build().unwrap(), &course);
            let outcome = environment.step(&[action], &course, &mut Tally::default()).unwrap();
            (outcome, environment.observation().to_vec())
        };
        assert_eq!(stepped(5.0), stepped(1.0));
        assert_eq!(stepped(-5.0), stepped(-1.0));
        assert_ne!(stepped(0.5), stepped(1.0));
    }

    #[test]
    fn put_down_and_taken_up_an_episode_goes_on_where_states_can_be_set() {
        let task = Task::default();
        let course = course(&task, 0.5, 100);
        let mut tally = Tally::default();
        for settable in [true, false] {
            let make = || match settable {
                true => PointMassConfig::default().build().unwrap(),
                false => replay_only(PointMassConfig::default()),
            };
            let no_d0 = Course { d0_share: 0.0, ..course.clone() };
            let mut environment = begun(make(), &no_d0);
            for _ in 0..3 {
                environment.step(&[0.5], &no_d0, &mut tally).unwrap();
            }
            let mut other = Environment::new(0, make());
            let goes_on = other.take_up(&environment.put_down(), &no_d0, &mut tally).unwrap();
            assert_eq!(goes_on, settable);
            let expected = if settable { (1, 3) } else { (2, 0) };
            assert_eq!((other.episode().number, other.episode().steps), expected);
            assert_eq!(other.observation() == environment.observation(), settable);
        }
    }
}
