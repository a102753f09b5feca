//! Whoever chooses the actions of a rollout: the infant agent (§4.2, Fig. 5.2) and those it is compared with.

use rand::RngExt as _;

use crate::policy::{OptionPolicy, TeacherPolicy};
use crate::seed::Stream;
use crate::spec::SimulatorSpec;

/// Chooses actions through one rollout after another.
pub trait Agent {
    /// A rollout begins at `observation`.
    fn begin(&mut self, _observation: &[f32], _noise: &mut Stream) {}

    /// Writes every component of the action for `observation`: `observation_size` numbers in, one out for each component of the spec's
    /// bounds. It may lie outside them, where the simulator clamps it; one that is not finite ends the rollout as failed. Slices of
    /// another length are a mistake of the caller, who may see a panic.
    fn act(&mut self, observation: &[f32], noise: &mut Stream, action: &mut [f32]);

    /// Why the last action was not finite, see [`TeacherPolicy::trouble`].
    fn trouble(&mut self) -> Option<String> {
        None
    }
}

/// Draws every action uniformly between the spec's bounds.
#[derive(Clone, Debug)]
pub struct RandomTorque {
    low: Vec<f32>,
    high: Vec<f32>,
}

impl RandomTorque {
    /// Uniform within the bounds of `spec`.
    pub fn new(spec: &SimulatorSpec) -> Self {
        Self { low: spec.action_low.clone(), high: spec.action_high.clone() }
    }
}

impl Agent for RandomTorque {
    fn act(&mut self, _: &[f32], noise: &mut Stream, action: &mut [f32]) {
        for ((a, low), high) in action.iter_mut().zip(&self.low).zip(&self.high) {
            *a = low + noise.random::<f32>() * (high - low);
        }
    }
}

/// Does nothing: what the body does by itself.
#[derive(Clone, Copy, Debug)]
pub struct ZeroTorque;

impl Agent for ZeroTorque {
    fn act(&mut self, _: &[f32], _: &mut Stream, action: &mut [f32]) {
        action.fill(0.0);
    }
}

/// Follows a teacher.
pub struct Taught<'a> {
    /// The teacher.
    pub policy: &'a dyn TeacherPolicy,
    /// Whether actions are samples rather than the mean action.
    pub sampling: bool,
}

impl Agent for Taught<'_> {
    fn act(&mut self, observation: &[f32], noise: &mut Stream, action: &mut [f32]) {
        self.policy.act(observation, self.sampling.then_some(noise), action);
    }

    fn trouble(&mut self) -> Option<String> {
        self.policy.trouble()
    }
}

/// Which of some things a uniform number in [0, 1) picks, each with a probability proportional to its weight. Weights are at least
/// 0, and not all 0.
///
/// # Panics
/// Without a weight.
pub fn pick(weights: &[f64], uniform: f64) -> usize {
    let mut left = uniform * weights.iter().sum::<f64>();
    let picked = weights.iter().position(|weight| {
        left -= weight;
        left < 0.0
    });
    picked.unwrap_or(weights.len() - 1)
}

/// The infant agent: picks an option at random by its interest (uniformly where options have none), runs it to its end,
/// picks again. With `primitive_probability` a decision is one uniformly random primitive action instead.
pub struct InfantAgent<'a> {
    options: &'a [&'a dyn OptionPolicy],
    primitive_probability: f64,
    primitive: RandomTorque,
    running: Running,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Running {
    Nothing,
    Primitive,
    Option { index: usize, elapsed: usize },
}

impl<'a> InfantAgent<'a> {
    /// The agent that has nothing but `options`, of which there must be at least one.
    pub fn new(options: &'a [&'a dyn OptionPolicy], spec: &SimulatorSpec) -> Self {
        Self::mixed(options, 0.0, spec)
    }

    /// The mixed agent: each decision is a primitive action with `primitive_probability`, else an option.
    pub fn mixed(
        options: &'a [&'a dyn OptionPolicy],
        primitive_probability: f64,
        spec: &SimulatorSpec,
    ) -> Self {
        debug_assert!(!options.is_empty());
        Self { options, primitive_probability, primitive: RandomTorque::new(spec), running: Running::Nothing }
    }

    /// `π_I(o|s)` of Eq. 6.3: an option with probability proportional to its interest.
    fn pick(&self, observation: &[f32], noise: &mut Stream) -> usize {
        if self.options.len() == 1 {
            return 0;
        }
        let interests: Vec<f64> = self.options.iter().map(|o| f64::from(o.interest(observation))).collect();
        pick(&interests, noise.random())
    }

    fn decide(&mut self, observation: &[f32], noise: &mut Stream) {
        let primitive =
            self.primitive_probability > 0.0 && noise.random::<f64>() < self.primitive_probability;
        self.running = if primitive {
            Running::Primitive
        } else {
            Running::Option { index: self.pick(observation, noise), elapsed: 0 }
        };
    }

    /// `β_o(s)`: whether what runs ends before the next action.
    fn ends(&self, observation: &[f32], noise: &mut Stream) -> bool {
        match self.running {
            Running::Nothing | Running::Primitive => true,
            Running::Option { elapsed: 0, .. } => false,
            Running::Option { index, elapsed } => {
                let probability = self.options[index].termination(observation, elapsed);
                probability >= 1.0 || (probability > 0.0 && noise.random::<f64>() < probability)
            }
        }
    }
}

impl Agent for InfantAgent<'_> {
    fn begin(&mut self, _: &[f32], _: &mut Stream) {
        self.running = Running::Nothing;
    }

    fn act(&mut self, observation: &[f32], noise: &mut Stream, action: &mut [f32]) {
        if self.ends(observation, noise) {
            self.decide(observation, noise);
        }
        match &mut self.running {
            Running::Option { index, elapsed } => {
                self.options[*index].act(observation, *elapsed, noise, action);
                *elapsed += 1;
            }
            Running::Nothing | Running::Primitive => self.primitive.act(observation, noise, action),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::conformance::point_mass::PointMassConfig;
    use crate::policy::PolicyRecord;
    use crate::seed::Seed;
    use crate::tensors::Tensors;

    /// Pushes with a fixed force for three steps.
    #[derive(Debug)]
    struct Push {
        force: f32,
        interest: f32,
    }

    impl OptionPolicy for Push {
        fn interest(&self, _: &[f32]) -> f32 {
            self.interest
        }
        fn act(&self, _: &[f32], _: usize, _: &mut Stream, action: &mut [f32]) {
            action.fill(self.force);
        }
        fn termination(&self, _: &[f32], elapsed: usize) -> f64 {
            f64::from(elapsed >= 3)
        }
        fn record(&self) -> PolicyRecord {
            PolicyRecord { format: "push".to_owned(), tensors: Tensors::new() }
        }
    }

    fn actions(agent: &mut dyn Agent, steps: usize) -> Vec<f32> {
        let mut noise = Seed::root(5).stream();
        agent.begin(&[0.0; 2], &mut noise);
        let mut action = [0.0];
        (0..steps)
            .map(|_| {
                agent.act(&[0.0; 2], &mut noise, &mut action);
                action[0]
            })
            .collect()
    }

    #[test]
    fn uniform_numbers_pick_by_weight() {
        assert_eq!([0.0, 0.24, 0.25, 0.999_999].map(|u| pick(&[0.5, 0.0, 1.5], u)), [0, 0, 2, 2]);
        // Of equal ones, by the whole part of as many times the number.
        for index in 0..1000 {
            let uniform = f64::from(index) / 1000.0 + 1e-4;
            assert_eq!(pick(&[0.2; 5], uniform), (5.0 * uniform) as usize);
        }
        // What rounding leaves is the last one's.
        assert_eq!(pick(&[0.1; 3], 1.0), 2);
    }

    #[test]
    fn options_run_to_their_end_and_are_picked_by_interest() {
        let spec = PointMassConfig::default().description();
        let (often, seldom) = (Push { force: 1.0, interest: 3.0 }, Push { force: -1.0, interest: 1.0 });
        let options: [&dyn OptionPolicy; 2] = [&often, &seldom];
        let actions = actions(&mut InfantAgent::new(&options, &spec), 30_000);
        assert!(actions.as_chunks::<3>().0.iter().all(|[a, b, c]| a == b && b == c));
        let share = actions.iter().filter(|a| **a > 0.0).count() as f64 / 30_000.0;
        // Binomial with 10,000 decisions: standard error sqrt(0.75 * 0.25 / 10000) = 0.0043.
        assert!((share - 0.75).abs() < 4.0 * 0.0043, "{share}");
    }

    #[test]
    fn the_mixed_agent_takes_primitive_actions_at_its_rate() {
        let spec = PointMassConfig::default().description();
        let push = Push { force: 7.0, interest: 1.0 };
        let options: [&dyn OptionPolicy; 1] = [&push];
        let actions = actions(&mut InfantAgent::mixed(&options, 0.5, &spec), 40_000);
        // Half of the decisions last one step and half three, so a quarter of all steps are primitive.
        let share = actions.iter().filter(|a| **a != 7.0).count() as f64 / 40_000.0;
        assert!((share - 0.25).abs() < 0.02, "{share}");
    }
}
