//! Open-loop options (§5.1): the teacher's actions played again, whatever the robot sees.

use elo_core::fault::Faults;
use elo_core::policy::{
    Demonstration, Imitate, OptionLearner, OptionPolicy, PolicyFormat, PolicyRecord, Way,
};
use elo_core::seed::{Seed, Stream};
use elo_core::spec::SimulatorSpec;
use elo_core::tensors::{TensorError, Tensors};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::demonstration;

/// The tensor `actions` `[T, J]`, see [`OpenLoopPolicy`].
pub const FORMAT: PolicyFormat = PolicyFormat {
    name: "open_loop",
    summary: "a fixed sequence of actions: actions [steps, action components]",
    load,
};

/// Options that replay the actions of the demonstration one by one (the paper's choice, §5.1).
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OpenLoopConfig {}

#[typetag::serde(name = "open_loop")]
impl OptionLearner for OpenLoopConfig {
    fn validate(&self, _faults: &mut Faults) {}

    fn way(&self) -> Way<'_> {
        Way::Imitates(self)
    }
}

impl Imitate for OpenLoopConfig {
    fn learn(
        &self,
        demonstration: &Demonstration,
        spec: &SimulatorSpec,
        _seed: &Seed,
    ) -> Result<Box<dyn OptionPolicy>, String> {
        demonstration::check(demonstration, spec, usize::MAX)?;
        Ok(Box::new(OpenLoopPolicy { actions: demonstration.actions.clone(), width: spec.action_size() }))
    }
}

/// Plays `T` stored actions and ends after the last. Asked to go on, it repeats the last.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenLoopPolicy {
    /// `T` rows of `width` numbers, at least one.
    actions: Vec<f32>,
    width: usize,
}

impl OpenLoopPolicy {
    fn steps(&self) -> usize {
        self.actions.len() / self.width
    }
}

impl OptionPolicy for OpenLoopPolicy {
    fn act(&self, _observation: &[f32], elapsed: usize, _noise: &mut Stream, action: &mut [f32]) {
        let row = elapsed.min(self.steps() - 1);
        action.copy_from_slice(&self.actions[row * self.width..][..self.width]);
    }

    fn termination(&self, _observation: &[f32], elapsed: usize) -> f64 {
        if elapsed >= self.steps() { 1.0 } else { 0.0 }
    }

    fn record(&self) -> PolicyRecord {
        let mut tensors = Tensors::new();
        tensors.insert("actions", &[self.steps(), self.width], self.actions.clone());
        PolicyRecord { format: FORMAT.name.to_owned(), tensors }
    }
}

fn load(tensors: &Tensors, spec: &SimulatorSpec) -> Result<Box<dyn OptionPolicy>, TensorError> {
    let width = spec.action_size();
    let tensor = tensors.get("actions")?;
    match tensor.shape[..] {
        [steps, columns] if steps > 0 && columns > 0 && columns == width => {}
        _ => {
            let (name, expected) = ("actions".to_owned(), format!("[at least 1, {width}]"));
            return Err(TensorError::Shape { name, got: tensor.shape.clone(), expected });
        }
    }
    if !tensor.data.iter().all(|a| a.is_finite()) {
        return Err(TensorError::NotFinite("actions".to_owned()));
    }
    Ok(Box::new(OpenLoopPolicy { actions: tensor.data.clone(), width }))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use elo_core::conformance::point_mass::PointMassConfig;

    use super::*;

    fn learn(actions: &[f32], steps: usize) -> Result<Box<dyn OptionPolicy>, String> {
        let demonstration =
            Demonstration { observations: vec![0.0; 2 * steps], actions: actions.to_vec(), steps };
        OpenLoopConfig {}.learn(&demonstration, &PointMassConfig::default().description(), &Seed::root(1))
    }

    #[test]
    fn actions_are_replayed_in_order_and_the_last_is_held() {
        let option = learn(&[0.5, -1.5, 0.25], 3).unwrap();
        let stored = load(&option.record().tensors, &PointMassConfig::default().description()).unwrap();
        for option in [option, stored] {
            let mut action = [0.0];
            for (elapsed, expected) in [(0, 0.5), (1, -1.5), (2, 0.25), (3, 0.25), (900, 0.25)] {
                option.act(&[f32::NAN, 0.0], elapsed, &mut Seed::root(1).stream(), &mut action);
                assert_eq!(action, [expected]);
                assert_eq!(option.termination(&[], elapsed), if elapsed < 3 { 0.0 } else { 1.0 });
            }
        }
    }

    #[test]
    fn tensors_of_another_robot_are_refused() {
        let spec = PointMassConfig::default().description();
        for shape in [vec![0, 1], vec![3, 2], vec![3], vec![3, 1, 1]] {
            let mut tensors = Tensors::new();
            tensors.insert("actions", &shape, vec![0.0; shape.iter().product()]);
            let error = load(&tensors, &spec).unwrap_err();
            assert!(error.to_string().contains("expected [at least 1, 1]"), "{error}");
        }
        let mut tensors = Tensors::new();
        tensors.insert("actions", &[1, 1], vec![f32::NAN]);
        assert_eq!(load(&tensors, &spec).unwrap_err(), TensorError::NotFinite("actions".to_owned()));
    }
}
