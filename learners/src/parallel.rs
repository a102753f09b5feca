//! Work that several threads share without a trace of it in what comes out.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::panic::resume_unwind;
use std::sync::{Mutex, PoisonError};

/// Makes items 0, 1, 2, … and hands them to `take` in this order, until it breaks off with a value. Each worker makes one item
/// at a time, in a thread of its own if there are several; what was begun beyond the last item taken is dropped. So `take` sees
/// the same items whatever the number of workers, if what `make` makes depends on the number of the item alone.
///
/// # Panics
/// Without a worker, and as `make` or `take` do: then no further item is begun.
pub(crate) fn in_order<W: Send, T: Send, B: Send>(
    workers: &mut [W],
    make: impl Fn(&mut W, u64) -> T + Sync,
    mut take: impl FnMut(T) -> ControlFlow<B> + Send,
) -> B {
    if let [worker] = workers {
        let broken_off = (0..).find_map(|number| take(make(worker, number)).break_value());
        return broken_off.expect("there is no last number");
    }
    let closed = false;
    let desk = Mutex::new(Desk { begun: 0, taken: 0, waiting: BTreeMap::new(), outcome: None, closed });
    let take = Mutex::new(take);
    let work = |worker: &mut W| {
        let _closes = ClosesOnPanic(&desk);
        loop {
            let begun = lock(&desk).begin();
            let Some(number) = begun else { return };
            let made = make(worker, number);
            lock(&desk).hand_in(number, made, &mut *lock(&take));
        }
    };
    std::thread::scope(|scope| {
        let work = &work;
        let threads: Vec<_> = workers.iter_mut().map(|worker| scope.spawn(move || work(worker))).collect();
        for thread in threads {
            if let Err(panic) = thread.join() {
                resume_unwind(panic);
            }
        }
    });
    let outcome = desk.into_inner().unwrap_or_else(PoisonError::into_inner).outcome;
    outcome.expect("there are workers, who end with an outcome")
}

/// A panic elsewhere closes the desk, and what it holds is not looked at any more.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Where items are handed in.
struct Desk<T, B> {
    begun: u64,
    taken: u64,
    /// Made before an earlier one was.
    waiting: BTreeMap<u64, T>,
    outcome: Option<B>,
    /// Whether there will be no outcome.
    closed: bool,
}

/// Closes the desk when its thread panics: the others would wait for an item that never comes.
struct ClosesOnPanic<'a, T, B>(&'a Mutex<Desk<T, B>>);

impl<T, B> Drop for ClosesOnPanic<'_, T, B> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            lock(self.0).closed = true;
        }
    }
}

impl<T, B> Desk<T, B> {
    fn begin(&mut self) -> Option<u64> {
        self.begun += 1;
        (self.outcome.is_none() && !self.closed).then_some(self.begun - 1)
    }

    fn hand_in(&mut self, number: u64, made: T, take: &mut dyn FnMut(T) -> ControlFlow<B>) {
        self.waiting.insert(number, made);
        while self.outcome.is_none()
            && let Some(next) = self.waiting.remove(&self.taken)
        {
            self.taken += 1;
            self.outcome = take(next).break_value();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    /// Items that take turns at being slow, until their sum reaches 1000.
    fn taken_by(workers: usize) -> (Vec<u64>, u64) {
        let mut taken = Vec::new();
        let mut made_by_each = vec![0_u64; workers];
        let sum = in_order(
            &mut made_by_each,
            |made, number| {
                *made += 1;
                std::thread::sleep(Duration::from_micros(if number % 3 == 0 { 500 } else { 0 }));
                number
            },
            |number| {
                taken.push(number);
                let sum = taken.iter().sum::<u64>();
                if sum < 1000 { ControlFlow::Continue(()) } else { ControlFlow::Break(sum) }
            },
        );
        assert!(made_by_each.iter().sum::<u64>() >= taken.len() as u64);
        (taken, sum)
    }

    #[test]
    fn items_are_taken_in_order_whoever_makes_them() {
        // 0 + 1 + … + 45 = 1035.
        let expected = ((0..=45).collect(), 1035);
        for workers in [1, 2, 5] {
            assert_eq!(taken_by(workers), expected, "{workers} workers");
        }
    }
    #[test]
    fn a_panic_ends_the_work_of_all() {
        let panics_at = |maker: u64, taker: u64, workers: usize| {
            let work = || {
                in_order(
                    &mut vec![(); workers],
                    |(), number| assert_ne!(number, maker, "making {number}"),
                    {
                        let mut taken = 0;
                        move |()| {
                            assert_ne!(taken, taker, "taking {taken}");
                            taken += 1;
                            ControlFlow::<()>::Continue(())
                        }
                    },
                );
            };
            let panic = std::panic::catch_unwind(work).expect_err("there is nothing else that ends it");
            panic.downcast_ref::<String>().expect("a message").clone()
        };
        for workers in [1, 2, 5] {
            assert!(panics_at(3, u64::MAX, workers).contains("making 3"), "{workers} workers");
            assert!(panics_at(u64::MAX, 3, workers).contains("taking 3"), "{workers} workers");
        }
    }
}
