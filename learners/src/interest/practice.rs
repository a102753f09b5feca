//! Rollouts of the infant agent, and what is kept of them.

use elo_core::agent::pick;
use elo_core::context::{Context, continue_past_end};
use elo_core::rollout::{Horizon, price};
use elo_core::seed::Stream;
use elo_core::simulator::{End, Simulator, SimulatorError, check_finite};
use rand::RngExt as _;

use super::drawing;
use super::learner::Learner;
use crate::kernels::running_moments::{Normalizer, RunningMoments};
use crate::nn::{DiagonalGaussian, Scratch};

/// The steps of some rollouts, one after the other; row `i` of each table belongs to step `i`.
#[derive(Clone, Debug, Default)]
pub(super) struct Experience {
    /// Normalised, one row a step.
    pub observations: Vec<f32>,
    /// Normalised observation and task features, one row a step.
    pub critic_inputs: Vec<f32>,
    /// As sampled, one row a step.
    pub actions: Vec<f32>,
    /// `o_t`.
    pub options: Vec<usize>,
    /// What else happened.
    pub steps: Vec<Taken>,
    /// `log π_o(a|s)` when it was taken.
    pub log_probs: Vec<f32>,
    /// `log π_I(o|s)` when it was drawn; 0 where the option before went on.
    pub draw_log_probs: Vec<f32>,
    /// Discounts `γ^t` since the rollout began.
    pub discounts: Vec<f64>,
    /// Where each rollout ended.
    pub ends: Vec<LastState>,
}

/// One control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Taken {
    /// Whether the option was drawn here, rather than continued.
    pub drawn: bool,
    /// `r_t`.
    pub reward: f64,
    /// Whether the rollout ends with this step, by itself or because it was cut short.
    pub last: bool,
}

/// The state that the last step of a rollout led to.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum LastState {
    /// The task ended the episode there.
    Terminal,
    /// The rollout was cut short there.
    Cut {
        /// Normalised.
        observation: Vec<f32>,
        /// The same with the task features.
        critic_input: Vec<f32>,
        /// Whether that was for another reason than the time limit, so that what it has earned is no return.
        early: bool,
    },
}

/// One rollout.
#[derive(Clone, Debug)]
pub(super) struct Rollout {
    /// Its steps.
    pub experience: Experience,
    /// Of the observations that were acted on.
    pub moments: RunningMoments,
    /// Why there are no more of them, if the simulator failed.
    pub failure: Option<SimulatorError>,
}

/// One rollout's task, start and limits.
pub(super) struct Episode<'a> {
    /// `τ` and `s_0`.
    pub context: &'a Context,
    /// `τ` as the critic sees it.
    pub features: &'a [f32],
    /// Time limit, and what a fall means.
    pub horizon: &'a Horizon,
    /// Steps that are wanted; at most the time limit.
    pub max_steps: u64,
    /// `γ`.
    pub gamma: f64,
}

/// The infant agent while it learns: acts by what [`Learner`] is now.
pub(super) struct Infant<'a> {
    /// Whose options it has.
    pub learner: &'a Learner,
    /// How observations are scaled.
    pub normalizer: &'a Normalizer,
    /// Working memory.
    pub scratch: Scratch,
}

impl Infant<'_> {
    /// Rolls out, and remembers every step. A simulator that fails cuts the rollout short before the step that did not
    /// take place.
    pub fn roll_out(
        &mut self,
        simulator: &mut dyn Simulator,
        episode: &Episode<'_>,
        noise: &mut Stream,
    ) -> Rollout {
        let moments = RunningMoments::new(simulator.spec().observation_size);
        let mut rollout = Rollout { experience: Experience::default(), moments, failure: None };
        rollout.failure = self.run(simulator, episode, noise, &mut rollout).err();
        rollout
    }

    fn run(
        &mut self,
        simulator: &mut dyn Simulator,
        episode: &Episode<'_>,
        noise: &mut Stream,
        Rollout { experience, moments, .. }: &mut Rollout,
    ) -> Result<(), SimulatorError> {
        let Context { task, start } = episode.context;
        let spec = simulator.spec();
        let (prices, mut terms) = (spec.prices(task), vec![0.0; spec.reward_terms.len()]);
        let (mut observation, mut seen) =
            (vec![0.0; spec.observation_size], vec![0.0; spec.observation_size]);
        let (mut action, mut clipped) = (vec![0.0; spec.action_size()], vec![0.0; spec.action_size()]);
        start.begin(simulator, task, &mut observation)?;
        check_finite(&observation, &[])?;

        let (mut running, mut discount) = (None, 1.0);
        for elapsed in 1..=episode.max_steps {
            self.normalizer.apply(&observation, &mut seen);
            let drawn = running.is_none();
            let (option, draw_log_prob) =
                running.map_or_else(|| self.draw(&seen, noise), |option| (option, 0.0));
            let log_prob = self.act(option, &seen, noise, &mut action);
            moments.update(&observation);
            clipped.copy_from_slice(&action);
            simulator.spec().clip(&mut clipped);
            let stepped = simulator.step(&clipped, &mut observation, &mut terms);
            let stepped = stepped.and_then(|end| check_finite(&observation, &terms).map(|()| end));
            let end = stepped.inspect_err(|_| experience.break_off(&seen, episode.features))?;

            experience.observations.extend(&seen);
            experience.critic_inputs.extend(seen.iter().chain(episode.features));
            experience.actions.extend(&action);
            experience.options.push(option);
            experience.log_probs.push(log_prob);
            experience.draw_log_probs.push(draw_log_prob);
            experience.discounts.push(discount);
            let fell_on = end == End::Terminated && !episode.horizon.stop_at_fall;
            let last = (end != End::Running && !fell_on) || elapsed == episode.max_steps;
            experience.steps.push(Taken { drawn, reward: price(&terms, &prices), last });
            if last {
                self.normalizer.apply(&observation, &mut seen);
                let early = end == End::Truncated || elapsed < episode.horizon.steps as u64;
                experience.ends.push(match end {
                    End::Terminated if !fell_on => LastState::Terminal,
                    _ => LastState::cut(&seen, episode.features, early),
                });
                break;
            }
            if fell_on {
                continue_past_end(simulator, task, &mut observation)
                    .inspect_err(|_| experience.break_off(&seen, episode.features))?;
            }
            discount *= episode.gamma;
            let ends = noise.random::<f64>() < self.learner.termination.probability();
            running = (!ends).then_some(option);
        }
        Ok(())
    }

    /// An option and the logarithm of its probability.
    fn draw(&mut self, seen: &[f32], noise: &mut Stream) -> (usize, f32) {
        let interests = &self.learner.interests;
        let mut log_interests = vec![0.0; interests.len()];
        for (z, interest) in log_interests.iter_mut().zip(interests) {
            let mut output = [0.0];
            interest.network.forward_one(seen, &mut self.scratch, &mut output);
            *z = f64::from(output[0]);
        }
        let mut probabilities = vec![0.0; interests.len()];
        drawing::probabilities(&log_interests, &mut probabilities);
        let option = pick(&probabilities, noise.random());
        // The probabilities are no longer needed.
        (option, drawing::log_probability(&log_interests, option, &mut probabilities) as f32)
    }

    /// Samples an action, and returns the logarithm of its density.
    fn act(&mut self, option: usize, seen: &[f32], noise: &mut Stream, action: &mut [f32]) -> f32 {
        let policy = &self.learner.policies[option];
        let mut means = vec![0.0; policy.log_std.len()];
        policy.means.network.forward_one(seen, &mut self.scratch, &mut means);
        let distribution = DiagonalGaussian { means: &means, log_std: &policy.log_std };
        distribution.sample(noise, action);
        distribution.log_prob(action)
    }
}

impl Experience {
    /// How many rollouts.
    pub fn rollouts(&self) -> f64 {
        self.ends.len() as f64
    }

    /// The rows where an option was drawn.
    pub fn drawn(&self) -> impl Iterator<Item = usize> {
        (0..self.steps.len()).filter(|&row| self.steps[row].drawn)
    }

    /// Adds the steps of another rollout behind these.
    pub fn append(&mut self, mut other: Self) {
        self.observations.append(&mut other.observations);
        self.critic_inputs.append(&mut other.critic_inputs);
        self.actions.append(&mut other.actions);
        self.options.append(&mut other.options);
        self.steps.append(&mut other.steps);
        self.log_probs.append(&mut other.log_probs);
        self.draw_log_probs.append(&mut other.draw_log_probs);
        self.discounts.append(&mut other.discounts);
        self.ends.append(&mut other.ends);
    }

    /// Cuts one rollout short after `count` steps, if it has more.
    pub fn truncate(&mut self, count: usize) {
        let steps = self.steps.len();
        if count >= steps {
            return;
        }
        let row = |table: &[f32]| table[count * (table.len() / steps)..][..table.len() / steps].to_vec();
        let (observation, critic_input) = (row(&self.observations), row(&self.critic_inputs));
        self.ends = vec![LastState::Cut { observation, critic_input, early: true }];
        for table in [&mut self.observations, &mut self.critic_inputs, &mut self.actions] {
            table.truncate(count * (table.len() / steps));
        }
        self.options.truncate(count);
        self.steps.truncate(count);
        self.log_probs.truncate(count);
        self.draw_log_probs.truncate(count);
        self.discounts.truncate(count);
        if let Some(step) = self.steps.last_mut() {
            step.last = true;
        }
    }

    /// Ends the rollout after the steps that there are, where `seen` is what they led to.
    fn break_off(&mut self, seen: &[f32], features: &[f32]) {
        if let Some(step) = self.steps.last_mut().filter(|step| !step.last) {
            step.last = true;
            self.ends.push(LastState::cut(seen, features, true));
        }
    }
}

impl LastState {
    fn cut(seen: &[f32], features: &[f32], early: bool) -> Self {
        Self::Cut { observation: seen.to_vec(), critic_input: [seen, features].concat(), early }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;
    use elo_core::context::InitialStates;
    use elo_core::policy::{Practice, Unwatched};
    use elo_core::simulator::SimulatorConfig;
    use elo_core::task::TaskDistribution;

    use super::super::config::InterestConfig;
    use super::super::train::Training;
    use super::super::worlds::{World, practice};
    use super::*;

    /// The lengths of rollouts of at most five steps, of so many together, and how they ended.
    fn rollouts(simulator: &dyn SimulatorConfig, steps: u64, stop_at_fall: bool) -> Vec<(usize, LastState)> {
        let config = InterestConfig {
            steps,
            rollout_steps: steps,
            context_pool: 4,
            hidden: vec![4],
            ..InterestConfig::default()
        };
        let (tasks, initial_states) =
            (TaskDistribution::default(), InitialStates { max_random_steps: 0, ..InitialStates::default() });
        let practice = practice(simulator, &tasks, &initial_states, 5, 1);
        let practice = Practice { horizon: Horizon { stop_at_fall, ..practice.horizon }, ..practice };
        let experience =
            Training::new(&config, &practice, &mut Unwatched).unwrap().collect(&mut Unwatched).unwrap();
        let lengths = experience.steps.split_inclusive(|step| step.last).map(<[Taken]>::len);
        lengths.zip(experience.ends.iter().cloned()).collect()
    }

    fn is_cut(end: &LastState, for_another_reason: bool) -> bool {
        matches!(end, LastState::Cut { early, .. } if *early == for_another_reason)
    }

    #[test]
    fn a_fall_ends_a_rollout_unless_falls_are_gone_through() {
        // So narrow that a few actions lead out of it.
        let narrow = PointMassConfig { wall: 0.01, reset_spread: 0.0 };
        let ends = rollouts(&narrow, 60, true);
        assert!(ends.iter().filter(|(_, end)| *end == LastState::Terminal).count() > 3, "{ends:?}");
        let ends = rollouts(&narrow, 60, false);
        assert_eq!(ends.len(), 12);
        assert!(ends.iter().all(|(length, end)| *length == 5 && is_cut(end, false)), "{ends:?}");
    }

    #[test]
    fn a_step_that_fails_cuts_the_rollout_before_it() {
        let ends = rollouts(&World::Failing, 20, true);
        assert_eq!(ends.len(), 10);
        assert!(ends.iter().all(|(length, end)| *length == 2 && is_cut(end, true)), "{ends:?}");
        assert!(
            rollouts(&World::Endless, 20, true)
                .iter()
                .all(|(length, end)| *length == 5 && is_cut(end, false))
        );
    }
}
