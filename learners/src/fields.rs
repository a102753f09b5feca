//! What several configs have in common: checks, and the widths of networks.

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

/// Widths of a network from `inputs` to `outputs`, through the `hidden` layers.
pub(crate) fn widths(inputs: usize, hidden: &[usize], outputs: usize) -> Vec<usize> {
    [&[inputs], hidden, &[outputs]].concat()
}

/// Refuses widths of hidden layers that are 0 or out of all proportion; there may be none.
pub(crate) fn check_hidden(faults: &mut Faults, hidden: &[usize]) {
    let sensible = hidden.len() <= 8 && hidden.iter().all(|width| (1..=4096).contains(width));
    faults.check(sensible, "hidden", || format!("expected at most 8 widths from 1 to 4096, got {hidden:?}"));
}
