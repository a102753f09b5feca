//! Checks of fields that several configs have.

use elo_core::fault::Faults;

/// Widths of hidden layers, none among them.
pub(crate) fn check_hidden(faults: &mut Faults, hidden: &[usize]) {
    let sensible = hidden.len() <= 8 && hidden.iter().all(|width| (1..=4096).contains(width));
    faults.check(sensible, "hidden", || format!("expected at most 8 widths from 1 to 4096, got {hidden:?}"));
}
