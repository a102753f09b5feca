//! What the tests of all suites share: the demand that a liar is caught by the check that is meant for it, and an
//! allocator that counts.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeSet;

use super::check::{Check, Report};

/// An implementation that is wrong in one way.
pub(super) struct Lie<S> {
    /// The check that is meant to find it.
    pub caught_by: &'static str,
    /// Others that cannot help finding it too, by name.
    pub also: &'static [&'static str],
    /// The liar.
    pub subject: S,
}

/// Demands that each liar is caught by its check, by those listed beside it and by no other, and that each check of the
/// suite has a liar of its own.
pub(super) fn demand_that_liars_are_caught<S>(checks: &[Check<S>], lies: &[Lie<Box<S>>])
where
    S: ?Sized,
{
    let names: BTreeSet<_> = checks.iter().map(|check| check.name).collect();
    assert_eq!(names.len(), checks.len(), "two checks share a name");
    let tried: BTreeSet<_> = lies.iter().map(|lie| lie.caught_by).collect();
    let untried: Vec<_> = names.difference(&tried).collect();
    assert!(untried.is_empty(), "no liar for {untried:?}");
    let mut surprises = String::new();
    for lie in lies {
        let report = Report::of(format!("the liar for {}", lie.caught_by), checks, lie.subject.as_ref());
        let failed: BTreeSet<_> = report.failed().into_iter().collect();
        let expected: BTreeSet<_> = lie.also.iter().copied().chain([lie.caught_by]).collect();
        if failed != expected {
            surprises += &format!("expected {expected:?} to fail\n{report}\n");
        }
    }
    assert!(surprises.is_empty(), "{surprises}");
}

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// How many allocations this thread made so far.
pub(super) fn allocations() -> u64 {
    ALLOCATIONS.with(Cell::get)
}

struct Counting;

#[global_allocator]
static COUNTING: Counting = Counting;

// SAFETY: every call is handed to the system's allocator unchanged; the counter is a thread-local number that needs
// neither memory nor a destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller keeps `alloc`'s contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps `dealloc`'s contract, and all memory comes from `System`.
        unsafe { System.dealloc(memory, layout) }
    }
}
