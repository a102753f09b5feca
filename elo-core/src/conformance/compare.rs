//! Comparisons that give both values when they fail.

use std::fmt;

use super::check::Violation;

/// A floating-point number of either width.
pub(super) trait Number: Copy + fmt::Display {
    /// The distance between two neighbours at 1.
    const EPSILON: f64;
    /// The exact bits, widened.
    fn bits(self) -> u64;
    /// The same number as `f64`.
    fn wide(self) -> f64;
}

impl Number for f32 {
    const EPSILON: f64 = f32::EPSILON as f64;
    fn bits(self) -> u64 {
        u64::from(self.to_bits())
    }
    fn wide(self) -> f64 {
        f64::from(self)
    }
}

impl Number for f64 {
    const EPSILON: f64 = f64::EPSILON;
    fn bits(self) -> u64 {
        self.to_bits()
    }
    fn wide(self) -> f64 {
        self
    }
}

/// Asks for the same bits in both, NaN and signed zeros included.
pub(super) fn same<N: Number>(what: &str, expected: &[N], got: &[N]) -> Result<(), Violation> {
    compare(what, expected, got, |a, b| a.bits() == b.bits())
}

/// Asks for `|a − b| <= tolerance · max(1, |a|, |b|)`, with a tolerance of at least one rounding of the type.
pub(super) fn near<N: Number>(
    what: &str,
    expected: &[N],
    got: &[N],
    tolerance: f64,
) -> Result<(), Violation> {
    let tolerance = tolerance.max(N::EPSILON);
    compare(what, expected, got, |a, b| {
        let scale = a.wide().abs().max(b.wide().abs()).max(1.0);
        a.bits() == b.bits() || (a.wide() - b.wide()).abs() <= tolerance * scale
    })
}

/// Asks for finite numbers.
pub(super) fn finite<N: Number>(what: &str, got: &[N]) -> Result<(), Violation> {
    match got.iter().position(|x| !x.wide().is_finite()) {
        None => Ok(()),
        Some(i) => Err(Violation::new(format!("{what}[{i}]"), "a finite number", got[i])),
    }
}

/// Asks that `result` is an error; `what` says what was tried.
pub(super) fn refused<T, E>(what: impl fmt::Display, result: Result<T, E>) -> Result<(), Violation> {
    match result {
        Err(_) => Ok(()),
        Ok(_) => Err(Violation::new(what, "an error", "success")),
    }
}

/// Asks that `result` is no error; `what` says what was tried.
pub(super) fn granted<T, E: fmt::Display>(
    what: impl fmt::Display,
    result: Result<T, E>,
) -> Result<T, Violation> {
    result.map_err(|error| Violation::new(what, "success", error))
}

fn compare<N: Number>(
    what: &str,
    expected: &[N],
    got: &[N],
    agree: impl Fn(N, N) -> bool,
) -> Result<(), Violation> {
    if expected.len() != got.len() {
        return Err(Violation::new(format!("length of {what}"), expected.len(), got.len()));
    }
    match expected.iter().zip(got).position(|(a, b)| !agree(*a, *b)) {
        None => Ok(()),
        Some(i) => Err(Violation::new(format!("{what}[{i}]"), expected[i], got[i])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_tell_zeros_apart_and_nearness_does_not() {
        assert!(same("x", &[0.0_f64], &[-0.0]).is_err());
        assert!(same("x", &[f64::NAN], &[f64::NAN]).is_ok());
        assert!(near("x", &[0.0_f64], &[-0.0], 0.0).is_ok());
    }

    #[test]
    fn nearness_is_relative_above_one_and_forgives_a_rounding() {
        assert!(near("x", &[1e6], &[1e6 + 0.5], 1e-6).is_ok());
        assert!(near("x", &[1e6], &[1e6 + 2.0], 1e-6).is_err());
        assert!(near("x", &[1.0_f32], &[1.0 + f32::EPSILON], 1e-9).is_ok());
        assert!(near("x", &[1.0_f64], &[f64::NAN], 1.0).is_err());
        assert!(near("x", &[1.0_f64], &[1.0, 2.0], 1.0).is_err());
    }
}
