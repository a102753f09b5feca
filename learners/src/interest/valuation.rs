//! What the critic says of the states of an iteration: `Q(s,o|τ)`, and `V(s|τ)` by the interests (Eq. 6.5).

use super::advantages::{Step, Values};
use super::drawing;
use super::learner::Learner;
use super::practice::{Experience, LastState, Taken};

/// States that are valued at once.
const BATCH: usize = 256;

/// `Q(s,·|τ)` and `V(s|τ)` of some states.
struct Worth {
    option_values: Vec<f64>,
    state_values: Vec<f64>,
}

impl Worth {
    /// Of the states with these rows of normalised observations and of critic inputs.
    fn of(learner: &mut Learner, observations: &[f32], critic_inputs: &[f32]) -> Self {
        let (width, critic_width) =
            (learner.interests[0].network.input_size(), learner.critic.network.input_size());
        let options = learner.options();
        let (mut log_interests, mut probabilities) = (vec![0.0; BATCH * options], vec![0.0; options]);
        let mut worth = Self { option_values: Vec::new(), state_values: Vec::new() };
        let batches = observations.chunks(BATCH * width).zip(critic_inputs.chunks(BATCH * critic_width));
        for (observations, critic_inputs) in batches {
            for (option, interest) in learner.interests.iter_mut().enumerate() {
                let places = log_interests[option..].iter_mut().step_by(options);
                places.zip(interest.forward(observations)).for_each(|(z, output)| *z = f64::from(*output));
            }
            let first = worth.option_values.len();
            worth.option_values.extend(learner.critic.forward(critic_inputs).iter().map(|q| f64::from(*q)));
            let option_values = worth.option_values[first..].chunks_exact(options);
            for (z, q) in log_interests.chunks_exact(options).zip(option_values) {
                drawing::probabilities(z, &mut probabilities);
                worth.state_values.push(drawing::state_value(&probabilities, q));
            }
        }
        worth
    }

    fn values(&self, state: usize, option: usize) -> Values {
        let options = self.option_values.len() / self.state_values.len();
        Values { option: self.option_values[state * options + option], state: self.state_values[state] }
    }
}

/// The steps with their values. Those after a step are what the critic says of the next state with the option that was running,
/// and 0 where the task ended the episode.
pub(super) fn value(learner: &mut Learner, experience: &Experience) -> Vec<Step> {
    let (mut cut_observations, mut cut_critic_inputs) = (Vec::new(), Vec::new());
    for end in &experience.ends {
        if let LastState::Cut { observation, critic_input, .. } = end {
            cut_observations.extend(observation);
            cut_critic_inputs.extend(critic_input);
        }
    }
    let along = Worth::of(learner, &experience.observations, &experience.critic_inputs);
    let beyond = Worth::of(learner, &cut_observations, &cut_critic_inputs);

    let (mut ends, mut cuts) = (experience.ends.iter(), 0..);
    let rows = experience.steps.iter().zip(&experience.options).enumerate();
    let valued = |(row, (&Taken { drawn, reward, last }, &option))| {
        let after = if !last {
            along.values(row + 1, option)
        } else if ends.next().expect("each rollout has an end") == &LastState::Terminal {
            Values::default()
        } else {
            beyond.values(cuts.next().expect("numbers do not end"), option)
        };
        Step { drawn, reward, here: along.values(row, option), after, last }
    };
    rows.map(valued).collect()
}
