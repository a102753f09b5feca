//! Checks that several configs have in common.

use elo_core::fault::Faults;

/// Refuses a config that is used without having been checked.
///
/// # Errors
/// The first fault that `validate` finds, in a sentence.
pub(crate) fn refuse_faults(validate: impl FnOnce(&mut Faults)) -> Result<(), String> {
    let mut faults = Faults::new();
    validate(&mut faults);
    faults.found().first().map_or(Ok(()), |fault| Err(fault.to_string()))
}

/// Widths of hidden layers, none among them.
pub(crate) fn check_hidden(faults: &mut Faults, hidden: &[usize]) {
    let sensible = hidden.len() <= 8 && hidden.iter().all(|width| (1..=4096).contains(width));
    faults.check(sensible, "hidden", || format!("expected at most 8 widths from 1 to 4096, got {hidden:?}"));
}
