//! A value that one thread uses at a time, where nobody ever waits: not for the value, and not to take it away.

use std::cell::UnsafeCell;
use std::sync::atomic::{AtomicU8, Ordering};

const FREE: u8 = 0;
const BUSY: u8 = 1;
/// Busy, and whoever uses it takes it away afterwards.
const LEAVING: u8 = 2;
const GONE: u8 = 3;

/// Why a value cannot be used now.
#[derive(Debug, PartialEq, Eq)]
pub enum Refused {
    /// Another thread is using it: try again.
    Busy,
    /// It was taken away.
    Gone,
}

/// See the module.
pub struct Exclusive<T> {
    state: AtomicU8,
    value: UnsafeCell<Option<T>>,
}

// SAFETY: the state lets one thread at a time at the value, so that sharing it is as good as sending it.
unsafe impl<T: Send> Sync for Exclusive<T> {}

impl<T> Exclusive<T> {
    /// A value that is free to use.
    pub fn new(value: T) -> Self {
        Self {
            state: AtomicU8::new(FREE),
            value: UnsafeCell::new(Some(value)),
        }
    }

    /// Uses the value, unless another thread does or it is gone.
    #[inline]
    pub fn try_with<R>(&self, action: impl FnOnce(&mut T) -> R) -> Result<R, Refused> {
        // Acquire: sees what the last user wrote before its Release in `Use::drop`.
        match self
            .state
            .compare_exchange(FREE, BUSY, Ordering::Acquire, Ordering::Relaxed)
        {
            Ok(_) => {}
            Err(GONE) => return Err(Refused::Gone),
            Err(_) => return Err(Refused::Busy),
        }
        let used = Use(self);
        // SAFETY: this thread has just made the value its own, until `used` is dropped.
        let value = unsafe { &mut *self.value.get() };
        let result = value.as_mut().map(action).ok_or(Refused::Gone);
        drop(used);
        result
    }

    /// Takes the value away: at once when it is free, else by the thread that uses it, when it is done.
    pub fn retire(&self) {
        let retired = |state| match state {
            FREE => Some(GONE),
            BUSY => Some(LEAVING),
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

    /// Only for the thread that the state names as the last.
    fn discard(&self) {
        // SAFETY: the state is GONE by this thread's own doing, so nobody else reaches the value.
        drop(unsafe { (*self.value.get()).take() });
    }
}

/// Ends a use, also when the action panics.
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
            self.0.state.store(GONE, Ordering::Relaxed);
            self.0.discard();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn a_retired_value_is_dropped_at_once_and_refused() {
        let value = Arc::new(());
        let exclusive = Exclusive::new(value.clone());
        exclusive.retire();
        assert_eq!(Arc::strong_count(&value), 1);
        assert_eq!(exclusive.try_with(|_| ()), Err(Refused::Gone));
    }

    #[test]
    fn a_value_in_use_is_refused_and_dropped_by_its_user() {
        let value = Arc::new(());
        let exclusive = Exclusive::new(value.clone());
        let inner = exclusive.try_with(|_| {
            exclusive.retire();
            assert_eq!(Arc::strong_count(&value), 2, "the user still has it");
            exclusive.try_with(|_| ())
        });
        assert_eq!(inner, Ok(Err(Refused::Busy)));
        assert_eq!(Arc::strong_count(&value), 1);
        assert_eq!(exclusive.try_with(|_| ()), Err(Refused::Gone));
    }

    #[test]
    fn a_panic_gives_the_value_back() {
        let exclusive = Exclusive::new(1);
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            let _ = exclusive.try_with(|_| panic!("on purpose"));
        }));
        assert!(panicked.is_err());
        assert_eq!(exclusive.try_with(|value| *value), Ok(1));
    }

    #[test]
    fn threads_never_use_it_together() {
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
