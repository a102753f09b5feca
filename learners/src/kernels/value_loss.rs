//! The critic's loss.

/// Half the mean squared error of `values` against `targets`; writes its derivatives by the values, `(V − target) / n`.
/// The sum is in double precision.
///
/// # Panics
/// When lengths differ or the batch is empty.
pub fn value_loss(values: &[f32], targets: &[f32], d_values: &mut [f32]) -> f32 {
    assert!(!values.is_empty(), "a value loss of an empty batch");
    assert_eq!(targets.len(), values.len(), "targets");
    assert_eq!(d_values.len(), values.len(), "derivatives by the values");
    let count = values.len() as f64;
    let mut squares = 0.0_f64;
    for ((derivative, value), target) in d_values.iter_mut().zip(values).zip(targets) {
        let error = value - target;
        *derivative = error / count as f32;
        squares += f64::from(error) * f64::from(error);
    }
    (0.5 * squares / count) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::reference;

    #[test]
    fn the_loss_is_that_worked_out_by_hand() {
        // Errors 1, −2, 0, 3: ½ · (1 + 4 + 0 + 9)/4 = 1.75; derivatives 0.25, −0.5, 0, 0.75.
        let mut derivatives = [9.0; 4];
        assert_eq!(value_loss(&[2.0, 0.0, 5.0, 1.0], &[1.0, 2.0, 5.0, -2.0], &mut derivatives), 1.75);
        assert_eq!(derivatives, [0.25, -0.5, 0.0, 0.75]);
    }

    #[test]
    fn derivatives_agree_with_finite_differences() {
        let values: Vec<f32> = (0..9).map(|i| (i as f32).sin()).collect();
        let targets: Vec<f32> = (0..9).map(|i| (i as f32 * 0.3).cos()).collect();
        let mut derivatives = vec![0.0; 9];
        value_loss(&values, &targets, &mut derivatives);
        let loss = |values: &[f64]| {
            values.iter().zip(&targets).map(|(v, &t)| (v - f64::from(t)).powi(2)).sum::<f64>() / 18.0
        };
        let point: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
        let exact = reference::differences(&point, &[0, 1, 2, 3, 4, 5, 6, 7, 8], loss);
        assert!(reference::relative_error(&derivatives, &exact) < 1e-5, "{derivatives:?} {exact:?}");
    }
}
