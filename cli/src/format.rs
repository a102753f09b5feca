//! How figures are written, the same on the terminal and on the page.

use elo_core::figures::Row;
use elo_core::statistics::bootstrap::Interval;

/// A figure of a [`Row`].
pub struct Column {
    /// Above the column.
    pub heading: &'static str,
    /// Its name in `report.json`.
    pub field: &'static str,
    /// Digits after the point.
    pub digits: Digits,
    /// Its width on a terminal.
    pub width: usize,
    /// What stands in it.
    pub of: fn(&Row) -> &Interval,
}

/// The figures that tables show with an interval, from left to right.
pub const COLUMNS: [Column; 5] = [
    Column {
        heading: "return",
        field: "mean_return",
        digits: RETURN_DIGITS,
        width: 24,
        of: |r| &r.mean_return,
    },
    Column { heading: "mean", field: "mean", digits: SCORE_DIGITS, width: 22, of: |r| &r.mean },
    Column { heading: "IQM", field: "iqm", digits: SCORE_DIGITS, width: 22, of: |r| &r.iqm },
    Column {
        heading: "lower tail",
        field: "lower_tail",
        digits: SHARE_DIGITS,
        width: 20,
        of: |r| &r.lower_tail,
    },
    Column {
        heading: "upper tail",
        field: "upper_tail",
        digits: SHARE_DIGITS,
        width: 20,
        of: |r| &r.upper_tail,
    },
];

/// How many digits a figure has after the point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Digits {
    /// So many.
    Fixed(usize),
    /// As many as tell something: returns are thousands in one task and hundredths in another.
    AsNeeded,
}

impl From<usize> for Digits {
    fn from(digits: usize) -> Self {
        Self::Fixed(digits)
    }
}

impl Digits {
    /// For a figure of this size, or that is known to within this size.
    fn at(self, size: f64) -> usize {
        match self {
            Self::Fixed(digits) => digits,
            Self::AsNeeded if size == 0.0 || size >= 1.0 => 1,
            Self::AsNeeded if size >= 0.1 => 2,
            Self::AsNeeded => 3,
        }
    }
}

/// Digits of returns as the tasks pay them.
pub const RETURN_DIGITS: Digits = Digits::AsNeeded;
/// Digits of normalised returns and of scores.
pub const SCORE_DIGITS: Digits = Digits::Fixed(3);
/// Digits of shares and of correlations.
pub const SHARE_DIGITS: Digits = Digits::Fixed(2);

/// `8.2`, `0.82`.
pub fn number(value: f64, digits: impl Into<Digits>) -> String {
    let digits = digits.into().at(value.abs());
    format!("{value:.digits$}")
}

/// `0.286 [0.265, 0.309]`.
pub fn interval(interval: &Interval, digits: impl Into<Digits>) -> String {
    let Interval { estimate, low, high } = interval;
    let size = if high > low { high - low } else { estimate.abs() };
    let digits = digits.into().at(size);
    format!("{estimate:.digits$} [{low:.digits$}, {high:.digits$}]")
}

/// A share in percent, without its sign.
pub fn percent(share: f64, digits: usize) -> String {
    format!("{:.digits$}", share * 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_return_has_as_many_digits_as_tell_something() {
        for (value, text) in
            [(0.0, "0.0"), (-1234.56, "-1234.6"), (1.26, "1.3"), (0.256, "0.26"), (-0.0123, "-0.012")]
        {
            assert_eq!(number(value, RETURN_DIGITS), text);
        }
        for (estimate, low, high, text) in [
            (8.81, 5.12, 12.83, "8.8 [5.1, 12.8]"),
            (200.0, 199.9, 200.1, "200.00 [199.90, 200.10]"),
            (0.512, 0.498, 0.531, "0.512 [0.498, 0.531]"),
            (3.0, 3.0, 3.0, "3.0 [3.0, 3.0]"),
            (0.0, 0.0, 0.0, "0.0 [0.0, 0.0]"),
        ] {
            assert_eq!(interval(&Interval { estimate, low, high }, RETURN_DIGITS), text);
        }
        assert_eq!(
            interval(&Interval { estimate: 0.5, low: 0.5, high: 0.5 }, SCORE_DIGITS),
            "0.500 [0.500, 0.500]"
        );
    }
}
