//! Desks to work at: as many as may work at once, each with what somebody left there.

use std::ops::{Deref, DerefMut};
use std::sync::{Condvar, Mutex, PoisonError};

/// See the [module](self).
pub(crate) struct Desks<T> {
    free: Mutex<Vec<T>>,
    freed: Condvar,
}

impl<T> Desks<T> {
    /// A desk for each of these things.
    pub(crate) fn new(things: impl IntoIterator<Item = T>) -> Self {
        Self { free: Mutex::new(things.into_iter().collect()), freed: Condvar::new() }
    }

    /// Waits for a free desk and sits down.
    pub(crate) fn sit(&self) -> Desk<'_, T> {
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            if let Some(thing) = free.pop() {
                return Desk { desks: self, thing: Some(thing) };
            }
            free = self.freed.wait(free).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// A desk that is taken; free again when dropped.
pub(crate) struct Desk<'a, T> {
    desks: &'a Desks<T>,
    thing: Option<T>,
}

impl<T> Deref for Desk<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.thing.as_ref().expect("it lies there until the desk is free")
    }
}

impl<T> DerefMut for Desk<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        self.thing.as_mut().expect("it lies there until the desk is free")
    }
}

impl<T> Drop for Desk<'_, T> {
    fn drop(&mut self) {
        self.desks.free.lock().unwrap_or_else(PoisonError::into_inner).extend(self.thing.take());
        self.desks.freed.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn no_more_work_at_once_than_there_are_desks_even_after_a_panic() {
        let (desks, seated, most) = (Desks::new([0, 0]), AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            let panicking = scope.spawn(|| {
                let _desk = desks.sit();
                panic!("on purpose");
            });
            assert!(panicking.join().is_err());
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..100 {
                        let mut desk = desks.sit();
                        most.fetch_max(seated.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                        *desk += 1;
                        std::thread::yield_now();
                        seated.fetch_sub(1, Ordering::SeqCst);
                    }
                });
            }
        });
        assert!((1..=2).contains(&most.into_inner()));
        let (one, other) = (desks.sit(), desks.sit());
        assert_eq!(*one + *other, 800);
    }
}
