//! Rollouts of the infant agent, as the critic saw them.

use elo_core::rollout::price;
use elo_core::seed::Stream;
use elo_core::simulator::{End, Simulator, SimulatorError};
use elo_core::task::Task;
use rand::RngExt as _;

use super::advantages::{Advantages, Step, Values};
use super::drawing;
use super::learner::Learner;
use crate::kernels::running_moments::{Normalizer, RunningMoments};
use crate::nn::{DiagonalGaussian, Scratch};
use crate::ppo::environment::check_finite;

/// The steps of one iteration, rollout after rollout; row `i` of each belongs to step `i`.
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
    /// Rewards and values.
    pub steps: Vec<Step>,
    /// `log π_o(a|s)` when it was taken.
    pub log_probs: Vec<f32>,
    /// `log π_I(o|s)` at that time.
    pub draw_log_probs: Vec<f32>,
    /// Of each step's decisions.
    pub advantages: Vec<Advantages>,
    /// Discounts `γ^t` since the rollout began.
    pub discounts: Vec<f64>,
}

/// The infant agent while it learns: acts by what [`Learner`] is now, and remembers.
pub(super) struct Infant<'a> {
    /// Whose options it has.
    pub learner: &'a Learner,
    /// How observations are scaled.
    pub normalizer: &'a Normalizer,
    /// Of all observations acted on.
    pub moments: &'a mut RunningMoments,
    /// Where steps are added.
    pub experience: &'a mut Experience,
    /// Working memory.
    pub scratch: Scratch,
}

/// What an observation tells.
struct Seen {
    observation: Vec<f32>,
    critic_input: Vec<f32>,
    /// `z_·(s)`.
    log_interests: Vec<f64>,
    /// `π_I(·|s)`.
    probabilities: Vec<f64>,
    /// `Q(s,·|τ)`.
    option_values: Vec<f64>,
}

impl Seen {
    fn draw_log_prob(&self, option: usize) -> f32 {
        let mut derivatives = vec![0.0; self.log_interests.len()];
        drawing::log_probability(&self.log_interests, option, &mut derivatives) as f32
    }

    fn values(&self, option: usize) -> Values {
        let state = drawing::state_value(&self.probabilities, &self.option_values);
        Values { option: self.option_values[option], state }
    }
}

/// One rollout's task and limits.
pub(super) struct Episode<'a> {
    /// `τ`.
    pub task: &'a Task,
    /// `τ` as the critic sees it.
    pub features: &'a [f32],
    /// Time limit.
    pub max_steps: usize,
    /// `γ`.
    pub gamma: f64,
}

impl Infant<'_> {
    /// Rolls out from `observation`, where `simulator` is, and remembers every step. A simulator that fails cuts the
    /// rollout short before the step that did not take place.
    ///
    /// # Errors
    /// The simulator's, after everything up to it was remembered.
    pub fn roll_out(
        &mut self,
        simulator: &mut dyn Simulator,
        mut observation: Vec<f32>,
        episode: &Episode<'_>,
        noise: &mut Stream,
    ) -> Result<(), SimulatorError> {
        let prices = simulator.spec().prices(episode.task);
        let mut terms = vec![0.0; prices.len()];
        let mut running = None;
        let mut discount = 1.0;
        let mut seen = self.see(&observation, episode);
        for elapsed in 1..=episode.max_steps {
            let drawn = running.is_none();
            let option = running.unwrap_or_else(|| drawing::pick(&seen.probabilities, noise.random()));
            let (action, log_prob) = self.act(option, &seen.observation, noise);
            self.moments.update(&observation);
            let mut clipped = action.clone();
            simulator.spec().clip(&mut clipped);
            let stepped = simulator.step(&clipped, &mut observation, &mut terms);
            let stepped = stepped.and_then(|end| check_finite(&observation, &terms).map(|()| end));
            let end = stepped.inspect_err(|_| self.cut(elapsed))?;

            let after = self.see(&observation, episode);
            let step = Step {
                drawn,
                reward: price(&terms, &prices),
                here: seen.values(option),
                after: if end == End::Terminated { Values::default() } else { after.values(option) },
                last: end != End::Running || elapsed == episode.max_steps,
            };
            let experience = &mut *self.experience;
            experience.observations.extend(&seen.observation);
            experience.critic_inputs.extend(&seen.critic_input);
            experience.actions.extend(&action);
            experience.options.push(option);
            experience.log_probs.push(log_prob);
            experience.draw_log_probs.push(seen.draw_log_prob(option));
            experience.discounts.push(discount);
            experience.steps.push(step);
            if step.last {
                break;
            }
            discount *= episode.gamma;
            let ends = noise.random::<f64>() < self.learner.termination.probability();
            running = (!ends).then_some(option);
            seen = after;
        }
        Ok(())
    }

    /// Ends the rollout after the steps before this one.
    fn cut(&mut self, elapsed: usize) {
        if let (2.., Some(step)) = (elapsed, self.experience.steps.last_mut()) {
            step.last = true;
        }
    }

    fn see(&mut self, observation: &[f32], episode: &Episode<'_>) -> Seen {
        let Learner { interests, critic, .. } = self.learner;
        let mut normalized = vec![0.0; observation.len()];
        self.normalizer.apply(observation, &mut normalized);
        let critic_input = [&normalized, episode.features].concat();
        let mut values = vec![0.0; interests.len()];
        critic.network.forward_one(&critic_input, &mut self.scratch, &mut values);
        let log_interests: Vec<f64> = interests
            .iter()
            .map(|interest| {
                let mut z = [0.0];
                interest.network.forward_one(&normalized, &mut self.scratch, &mut z);
                f64::from(z[0])
            })
            .collect();
        let mut probabilities = vec![0.0; interests.len()];
        drawing::probabilities(&log_interests, &mut probabilities);
        let option_values = values.into_iter().map(f64::from).collect();
        Seen { observation: normalized, critic_input, log_interests, probabilities, option_values }
    }

    fn act(&mut self, option: usize, observation: &[f32], noise: &mut Stream) -> (Vec<f32>, f32) {
        let policy = &self.learner.policies[option];
        let (mut means, mut action) = (vec![0.0; policy.log_std.len()], vec![0.0; policy.log_std.len()]);
        policy.means.network.forward_one(observation, &mut self.scratch, &mut means);
        let distribution = DiagonalGaussian { means: &means, log_std: &policy.log_std };
        distribution.sample(noise, &mut action);
        let log_prob = distribution.log_prob(&action);
        (action, log_prob)
    }
}
