//! Figures in tables and in sentences, each with its exact value and the place in the run's files that it stands at.

use elo_core::figures::Row;
use elo_core::statistics::bootstrap::Interval;
use maud::{Markup, html};

use crate::format::{self, COLUMNS, Digits, interval, percent};

/// Where a figure stands: a file of `results/` and a JSON pointer into it.
#[derive(Clone, Debug)]
pub struct At(String);

impl At {
    /// The whole of `report.json`.
    pub fn report() -> Self {
        Self("report.json#".to_owned())
    }

    /// The whole of `experiments.json`.
    pub fn experiments() -> Self {
        Self("experiments.json#".to_owned())
    }

    /// The whole of `crosscheck.json`.
    pub fn crosscheck() -> Self {
        Self("crosscheck.json#".to_owned())
    }

    /// A field of an object, or an element of an array.
    pub fn then(&self, step: impl std::fmt::Display) -> Self {
        Self(format!("{}/{step}", self.0))
    }
}

/// An interval in a sentence.
pub fn figure(value: &Interval, digits: impl Into<Digits>, at: &At) -> Markup {
    let text = interval(value, digits);
    let (estimate, range) = text.split_once(' ').unwrap_or((&text, ""));
    html! {
        span.figure data-at=(at.0) data-value=(value.estimate) data-low=(value.low) data-high=(value.high) {
            (estimate) " " span.range { (range) }
        }
    }
}

/// A single number in a sentence.
pub fn number(value: f64, digits: impl Into<Digits>, at: &At) -> Markup {
    html! { span.figure data-at=(at.0) data-value=(value) { (format::number(value, digits)) } }
}

/// A share of rollouts, in percent, in a sentence.
pub fn share(value: &Interval, at: &At) -> Markup {
    let Interval { estimate, low, high } = value;
    html! {
        span.figure data-at=(at.0) data-percent="" data-value=(estimate) data-low=(low) data-high=(high) {
            (percent(*estimate, 0)) " % " span.range { "[" (percent(*low, 0)) ", " (percent(*high, 0)) "]" }
        }
    }
}

/// An interval in a table.
pub fn cell(value: &Interval, digits: impl Into<Digits>, at: &At) -> Markup {
    html! { td { (figure(value, digits, at)) } }
}

/// A single number in a table.
pub fn number_cell(value: f64, digits: impl Into<Digits>, at: &At) -> Markup {
    html! { td { (number(value, digits, at)) } }
}

/// A table that scrolls sideways where it is too wide.
pub fn table(caption: &str, headings: &[&str], body: &Markup) -> Markup {
    html! {
        div.scroll tabindex="0" role="region" aria-label=(caption) {
            table {
                caption { (caption) }
                thead { tr { @for heading in headings { th scope="col" { (heading) } } } }
                tbody { (body) }
            }
        }
    }
}

/// The headings above [`row`].
pub fn row_headings(first: &str) -> Vec<&str> {
    let figures = COLUMNS.iter().map(|column| column.heading);
    std::iter::once(first).chain(figures).chain(["falls", "steps"]).collect()
}

/// All figures of a [`Row`] under a name.
pub fn row(name: &Markup, row: &Row, at: &At) -> Markup {
    html! {
        tr {
            th scope="row" {
                (name)
                @if row.failures > 0.0 {
                    small.note {
                        span.figure data-at=(at.then("failures").0) data-percent="" data-value=(row.failures) {
                            (percent(row.failures, 1)) " %"
                        }
                        " of these rollouts failed"
                    }
                }
            }
            @for column in &COLUMNS { (cell((column.of)(row), column.digits, &at.then(column.field))) }
            td { (share(&row.falls, &at.then("falls"))) }
            (number_cell(row.mean_length, 0, &at.then("mean_length")))
        }
    }
}
