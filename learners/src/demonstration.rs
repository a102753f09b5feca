//! What every option learner asks of a demonstration.

use elo_core::policy::Demonstration;
use elo_core::spec::SimulatorSpec;

/// Checks that there are as many rows as steps, from 1 to `max_steps`, as wide as `spec` says, of finite numbers.
///
/// # Errors
/// A sentence that says what is wrong.
pub(crate) fn check(
    demonstration: &Demonstration,
    spec: &SimulatorSpec,
    max_steps: usize,
) -> Result<(), String> {
    let Demonstration { observations, actions, steps } = demonstration;
    if *steps == 0 || *steps > max_steps {
        return Err(format!("a demonstration has {steps} steps, expected 1 to {max_steps}"));
    }
    let (seen, done) = (spec.observation_size, spec.action_size());
    for (what, numbers, width) in [("observations", observations, seen), ("actions", actions, done)] {
        if Some(numbers.len()) != steps.checked_mul(width) || width == 0 {
            return Err(format!(
                "the {what} of a demonstration of {steps} steps are {} numbers, expected {steps} rows of {width}",
                numbers.len()
            ));
        }
        if let Some(index) = numbers.iter().position(|x| !x.is_finite()) {
            return Err(format!(
                "the {what} of step {} of a demonstration are not all finite",
                index / width
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use elo_core::conformance::point_mass::PointMassConfig;

    use super::*;

    fn fault(observations: &[f32], actions: &[f32], steps: usize) -> Option<String> {
        let demonstration =
            Demonstration { observations: observations.to_vec(), actions: actions.to_vec(), steps };
        check(&demonstration, &PointMassConfig::default().description(), 3).err()
    }

    #[test]
    fn each_fault_is_named() {
        assert_eq!(fault(&[0.1, 0.2, 0.3, 0.4], &[0.5, 0.6], 2), None);
        let expected = "a demonstration has 0 steps, expected 1 to 3";
        assert_eq!(fault(&[], &[], 0).as_deref(), Some(expected));
        assert_eq!(fault(&[0.0; 8], &[0.0; 4], 4).map(|text| text.contains("has 4 steps")), Some(true));
        let expected = "the observations of a demonstration of 2 steps are 3 numbers, expected 2 rows of 2";
        assert_eq!(fault(&[0.0; 3], &[0.0; 2], 2).as_deref(), Some(expected));
        let expected = "the actions of a demonstration of 2 steps are 3 numbers, expected 2 rows of 1";
        assert_eq!(fault(&[0.0; 4], &[0.0; 3], 2).as_deref(), Some(expected));
        let expected = "the actions of step 1 of a demonstration are not all finite";
        assert_eq!(fault(&[0.0; 4], &[0.0, f32::NAN], 2).as_deref(), Some(expected));
        let expected = "the observations of step 0 of a demonstration are not all finite";
        assert_eq!(fault(&[0.0, f32::INFINITY, 0.0, 0.0], &[0.0; 2], 2).as_deref(), Some(expected));
    }
}
