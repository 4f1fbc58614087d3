//! A value for one thread at a time, without waiting: neither using it nor retiring it blocks.

use std::cell::UnsafeCell;
use std::sync::atomic::{AtomicU8, Ordering};

const FREE: u8 = 0;
const BUSY: u8 = 1;
/// Busy, and its user drops it afterwards.
const RETIRING: u8 = 2;
const RETIRED: u8 = 3;

/// The reason why a value cannot be used.
#[derive(Debug, PartialEq, Eq)]
pub enum Unavailable {
    /// Another thread is using it; try again.
    Busy,
    /// It was retired.
    Retired,
}

/// A value with a state that admits one thread at a time.
pub struct Exclusive<T> {
    state: AtomicU8,
    value: UnsafeCell<Option<T>>,
}

// SAFETY: the state admits one thread at a time to the value, so that sharing it is like sending
// it.
unsafe impl<T: Send> Sync for Exclusive<T> {}

impl<T> Exclusive<T> {
    /// Returns a value that is free to use.
    pub fn new(value: T) -> Self {
        Self {
            state: AtomicU8::new(FREE),
            value: UnsafeCell::new(Some(value)),
        }
    }

    /// Passes the value to `action`, unless another thread uses it or it is retired.
    #[inline]
    pub fn try_with<R>(&self, action: impl FnOnce(&mut T) -> R) -> Result<R, Unavailable> {
        // Acquire: sees what the last user wrote before its Release in `Use::drop`.
        match self
            .state
            .compare_exchange(FREE, BUSY, Ordering::Acquire, Ordering::Relaxed)
        {
            Ok(_) => {}
            Err(RETIRED) => return Err(Unavailable::Retired),
            Err(_) => return Err(Unavailable::Busy),
        }
        let used = Use(self);
        // SAFETY: this thread alone may use the value until `used` is dropped.
        let value = unsafe { &mut *self.value.get() };
        let result = value.as_mut().map(action).ok_or(Unavailable::Retired);
        drop(used);
        result
    }

    /// Drops the value: at once if it is free, otherwise in the thread that uses it, afterwards.
    pub fn retire(&self) {
        let retired = |state| match state {
            FREE => Some(RETIRED),
            BUSY => Some(RETIRING),
            _ => None,
        };
        // Acquire: sees what the last user wrote before its Release in `Use::drop`.
        if self
            .state
            .fetch_update(Ordering::Acquire, Ordering::Acquire, retired)
            == Ok(FREE)
        {
            self.discard();
        }
    }

    /// Drops the value. Only for the thread that set the state to `RETIRED`.
    fn discard(&self) {
        // SAFETY: this thread has set the state to RETIRED, so no other thread reaches the value.
        drop(unsafe { (*self.value.get()).take() });
    }
}

/// Ends a use on drop, even when the action panics.
struct Use<'a, T>(&'a Exclusive<T>);

impl<T> Drop for Use<'_, T> {
    fn drop(&mut self) {
        // Release: pairs with the Acquire in `try_with` and `retire`.
        if self
            .0
            .state
            .compare_exchange(BUSY, FREE, Ordering::Release, Ordering::Relaxed)
            .is_err()
        {
            self.0.state.store(RETIRED, Ordering::Relaxed);
            self.0.discard();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn a_retired_value_is_dropped_at_once_and_unavailable() {
        let value = Arc::new(());
        let exclusive = Exclusive::new(value.clone());
        exclusive.retire();
        assert_eq!(Arc::strong_count(&value), 1);
        assert_eq!(exclusive.try_with(|_| ()), Err(Unavailable::Retired));
    }

    #[test]
    fn a_value_in_use_is_unavailable_and_dropped_by_its_user() {
        let value = Arc::new(());
        let exclusive = Exclusive::new(value.clone());
        let inner = exclusive.try_with(|_| {
            exclusive.retire();
            assert_eq!(Arc::strong_count(&value), 2, "the user still has it");
            exclusive.try_with(|_| ())
        });
        assert_eq!(inner, Ok(Err(Unavailable::Busy)));
        assert_eq!(Arc::strong_count(&value), 1);
        assert_eq!(exclusive.try_with(|_| ()), Err(Unavailable::Retired));
    }

    #[test]
    fn a_panic_releases_the_value() {
        let exclusive = Exclusive::new(1);
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let _ = exclusive.try_with(|_| panic!("on purpose"));
        }));
        assert!(panicked.is_err());
        assert_eq!(exclusive.try_with(|value| *value), Ok(1));
    }

    #[test]
    fn threads_never_use_the_value_together() {
        let exclusive = Exclusive::new((0_u64, 0_u64));
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    let mut done = 0;
                    while done < 10_000 {
                        let counted = exclusive.try_with(|(left, right)| {
                            *left += 1;
                            *right += 1;
                        });
                        done += u32::from(counted.is_ok());
                    }
                });
            }
        });
        assert_eq!(exclusive.try_with(|pair| *pair), Ok((40_000, 40_000)));
    }
}
