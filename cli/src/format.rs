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
    pub digits: usize,
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

/// Digits of returns as the tasks pay them.
pub const RETURN_DIGITS: usize = 1;
/// Digits of normalised returns and of scores.
pub const SCORE_DIGITS: usize = 3;
/// Digits of shares and of correlations.
pub const SHARE_DIGITS: usize = 2;

/// `0.286 [0.265, 0.309]`.
pub fn interval(interval: &Interval, digits: usize) -> String {
    let Interval { estimate, low, high } = interval;
    format!("{estimate:.digits$} [{low:.digits$}, {high:.digits$}]")
}

/// A share in percent, without its sign.
pub fn percent(share: f64, digits: usize) -> String {
    format!("{:.digits$}", share * 100.0)
}
