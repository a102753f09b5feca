//! What a simulator says about itself before anything is simulated.

use serde::{Deserialize, Serialize};

use crate::task::Task;

/// Sizes, bounds, time step, reward terms, task parameters and capabilities of one simulated robot.
///
/// Two simulators with equal [`SimulatorSpec::interface`] can exchange options.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorSpec {
    /// The robot, e.g. `half-cheetah`; options of one robot are refused by another.
    pub robot: String,
    /// Numbers in an observation.
    pub observation_size: usize,
    /// The least useful value of each action component. Actions outside the bounds are clamped by the simulator before
    /// they reach a motor, and the rollout loop counts them.
    pub action_low: Vec<f32>,
    /// The greatest useful value of each action component; same length as `action_low`.
    pub action_high: Vec<f32>,
    /// Simulated seconds between two actions. Must be positive.
    pub control_step: f64,
    /// What a step's reward is made of.
    pub reward_terms: Vec<RewardTerm>,
    /// What may differ between tasks.
    pub task_parameters: Vec<TaskParameter>,
    /// A lower bound on one step's reward. A failed evaluation is given this at every step (failure policy
    /// `worst_possible`), so it must lie below anything that a real rollout can earn on average.
    pub reward_floor: f64,
    /// What the simulator can do.
    pub capabilities: Capabilities,
}

/// One named part of the reward.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RewardTerm {
    /// Short name, unique in the spec.
    pub name: String,
    /// What a task pays for one unit of it.
    pub weight: Weight,
}

/// What one unit of a reward term is worth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    /// The same in every task.
    Constant(f64),
    /// The value of the task parameter with this name.
    Parameter(String),
}

/// One parameter of the task family.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TaskParameter {
    /// Its name in configs and files.
    pub name: String,
    /// Its value in a task that does not mention it.
    pub default: f64,
    /// The least value that makes sense.
    pub low: f64,
    /// The greatest value that makes sense.
    pub high: f64,
    /// Whether it only prices reward terms or changes how the robot moves.
    pub effect: Effect,
}

/// What a task parameter acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Effect {
    /// Only the weights of reward terms: one rollout of a policy that does not see the task prices every task.
    Reward,
    /// The motion itself: each task must be simulated.
    Dynamics,
}

/// What a simulator can do beyond stepping.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Capabilities {
    /// [`crate::simulator::Simulator::state`] works and `reset` accepts what it returned. Without it, starts are
    /// reached by replaying a seed and its prefix of actions.
    pub settable_state: bool,
}

impl SimulatorSpec {
    /// Brings each component of `action` between the bounds.
    pub fn clip(&self, action: &mut [f32]) {
        for (a, (low, high)) in action.iter_mut().zip(self.action_low.iter().zip(&self.action_high)) {
            *a = a.clamp(*low, *high);
        }
    }

    /// Components of an action.
    pub fn action_size(&self) -> usize {
        self.action_low.len()
    }

    /// The task parameter called `name`.
    pub fn task_parameter(&self, name: &str) -> Option<&TaskParameter> {
        self.task_parameters.iter().find(|parameter| parameter.name == name)
    }

    /// `w(τ)`: what `task` pays for one unit of each reward term, so that a reward is the inner product with the terms
    /// of its step, and a return that with the sums of the terms.
    pub fn prices(&self, task: &Task) -> Vec<f64> {
        self.reward_terms
            .iter()
            .map(|term| match &term.weight {
                Weight::Constant(weight) => *weight,
                Weight::Parameter(name) => self.parameter_value(task, name),
            })
            .collect()
    }

    /// The value of a parameter in `task`, or its default where the task does not mention it. A name that the spec
    /// does not declare is worth 0; [`Self::task_faults`] reports such names first.
    pub fn parameter_value(&self, task: &Task, name: &str) -> f64 {
        let default = || self.task_parameter(name).map_or(0.0, |parameter| parameter.default);
        task.get(name).unwrap_or_else(default)
    }

    /// Why `task` is no task of this simulator; empty when it is one.
    pub fn task_faults(&self, task: &Task) -> Vec<String> {
        task.parameters()
            .filter_map(|(name, value)| match self.task_parameter(name) {
                None => Some(format!("`{name}` is no task parameter of {}", self.robot)),
                Some(p) if !(p.low..=p.high).contains(&value) => {
                    Some(format!("`{name}` is {value}, outside {} to {}", p.low, p.high))
                }
                Some(_) => None,
            })
            .collect()
    }

    /// Why rollouts of the same options here and on `other` cannot be compared: the options do not fit both, or returns are
    /// not made of the same terms at the same prices. The order of the terms does not matter.
    pub fn incomparable(&self, other: &Self) -> Option<String> {
        let terms = |spec: &Self| {
            let mut terms: Vec<String> = spec.reward_terms.iter().map(|term| spec.priced(term)).collect();
            terms.sort_unstable();
            terms.join(", ")
        };
        let (ours, theirs) = (terms(self), terms(other));
        let fit = self.interface().difference(&other.interface());
        let fit = fit.map(|difference| format!("the options do not fit: {difference}"));
        fit.or_else(|| {
            (ours != theirs)
                .then(|| format!("returns cannot be compared: reward terms {ours} against {theirs}"))
        })
    }

    /// A term and what a task that mentions nothing pays for it, in words.
    fn priced(&self, term: &RewardTerm) -> String {
        match &term.weight {
            Weight::Constant(weight) => format!("`{}` at {weight}", term.name),
            Weight::Parameter(name) => {
                let default = self.parameter_value(&Task::default(), name);
                format!("`{}` at `{name}` ({default} by default)", term.name)
            }
        }
    }

    /// What must agree for an option of one simulator to run on another: robot, sizes, bounds and control step.
    pub fn interface(&self) -> Interface {
        Interface {
            robot: self.robot.clone(),
            observation_size: self.observation_size,
            action_low: self.action_low.clone(),
            action_high: self.action_high.clone(),
            control_step: self.control_step,
        }
    }
}

/// The part of a spec that options depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interface {
    /// See [`SimulatorSpec::robot`].
    pub robot: String,
    /// See [`SimulatorSpec::observation_size`].
    pub observation_size: usize,
    /// See [`SimulatorSpec::action_low`].
    pub action_low: Vec<f32>,
    /// See [`SimulatorSpec::action_high`].
    pub action_high: Vec<f32>,
    /// See [`SimulatorSpec::control_step`].
    pub control_step: f64,
}

impl Interface {
    /// The first difference to `other`, in words that name both sides.
    pub fn difference(&self, other: &Self) -> Option<String> {
        let differ = |what: &str, ours: String, theirs: String| {
            (ours != theirs).then(|| format!("{what} {ours} against {theirs}"))
        };
        differ("robot", self.robot.clone(), other.robot.clone())
            .or_else(|| {
                differ(
                    "observation size",
                    self.observation_size.to_string(),
                    other.observation_size.to_string(),
                )
            })
            .or_else(|| {
                differ("action size", self.action_low.len().to_string(), other.action_low.len().to_string())
            })
            .or_else(|| {
                differ("action low", format!("{:?}", self.action_low), format!("{:?}", other.action_low))
            })
            .or_else(|| {
                differ("action high", format!("{:?}", self.action_high), format!("{:?}", other.action_high))
            })
            .or_else(|| differ("control step", self.control_step.to_string(), other.control_step.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_prices_the_terms_that_it_names_and_defaults_serve_the_rest() {
        let spec = crate::conformance::point_mass::PointMassConfig::default().description();
        let dear = Task::new([("effort_cost", -2.0)]);
        assert_eq!(spec.prices(&Task::default()), [1.0, -0.1]);
        assert_eq!(spec.prices(&dear), [1.0, -2.0]);
        assert_eq!(spec.task_faults(&dear), Vec::<String>::new());
        assert_eq!(spec.task_faults(&Task::new([("effort", 0.0)])).len(), 1);
    }

    #[test]
    fn returns_compare_where_the_terms_and_their_prices_are_the_same_in_any_order() {
        let spec = crate::conformance::point_mass::PointMassConfig::default().description();
        let other = |change: fn(&mut SimulatorSpec)| {
            let mut other = spec.clone();
            change(&mut other);
            spec.incomparable(&other)
        };
        assert_eq!(other(|spec| spec.reward_terms.reverse()), None);
        let why = other(|spec| spec.reward_terms[0].name = "reward".to_owned());
        let expected = "returns cannot be compared: reward terms `closeness` at 1, `effort` at `effort_cost` (-0.1 by \
                        default) against `effort` at `effort_cost` (-0.1 by default), `reward` at 1";
        assert_eq!(why.as_deref(), Some(expected));
        assert!(other(|spec| spec.reward_terms[0].weight = Weight::Constant(2.0)).is_some());
        assert!(other(|spec| spec.task_parameters[0].default = -0.2).is_some());
        assert!(other(|spec| spec.reward_terms.truncate(1)).is_some());
        let why = other(|spec| spec.observation_size = 3);
        assert_eq!(why.as_deref(), Some("the options do not fit: observation size 2 against 3"));
    }
}
