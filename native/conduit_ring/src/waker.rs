//! Waking a subscriber from another thread of its process.

use std::fmt;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Mutex, PoisonError};

use crate::memory::Memory;
use crate::os::Event;
use crate::writer;

/// Wakes a subscriber from another thread.
///
/// A wake-up makes the subscriber's current [`wait`](crate::Subscriber::wait), or its next one,
/// return [`Wait::Woken`](crate::Wait::Woken) at once. A waker can be cloned and sent to any
/// thread.
///
/// ```
/// use std::thread;
/// use std::time::Duration;
/// use conduit_ring::{Subscriber, Topic, Wait};
///
/// # let name = format!("doc-waker-{}", std::process::id());
/// let mut subscriber = Subscriber::open(&Topic::new(&name)?, &Default::default())?;
/// let waker = subscriber.waker();
/// let thread = thread::spawn(move || waker.wake());
/// assert_eq!(subscriber.wait(Duration::from_secs(60))?, Wait::Woken);
/// # thread.join().unwrap();
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone)]
pub struct Waker {
    shared: Arc<Shared>,
}

/// A segment whose sleepers can be woken.
pub(crate) trait Alarm: Send + Sync {
    /// Wakes all of them.
    fn ring(&self);
}

impl Alarm for Memory {
    fn ring(&self) {
        writer::notify_all(self);
    }
}

struct Shared {
    /// Whether a wake-up is pending.
    woken: AtomicBool,
    /// What the subscriber sleeps on without a segment.
    event: Event,
    /// What the subscriber sleeps on with a segment. Set before it looks at `woken` for the last
    /// time, so that a wake-up after that look rings it.
    attached_to: Mutex<Option<Arc<dyn Alarm>>>,
}

impl Waker {
    pub(crate) fn new() -> io::Result<Waker> {
        let shared = Shared {
            woken: AtomicBool::new(false),
            event: Event::new()?,
            attached_to: Mutex::new(None),
        };
        Ok(Waker {
            shared: Arc::new(shared),
        })
    }

    /// Wakes the subscriber, whatever it sleeps on. Several wake-ups before its next wait count
    /// as one.
    pub fn wake(&self) {
        // SeqCst: pairs with the fence between a sleeper's preparations and its last look at
        // `woken`. Either that look sees the wake-up, or the event and the alarm below wake it.
        self.shared.woken.store(true, SeqCst);
        self.shared.event.raise();
        let attached_to = self
            .shared
            .attached_to
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        if let Some(alarm) = attached_to {
            alarm.ring();
        }
    }

    /// Sets the segment that the subscriber sleeps on.
    pub(crate) fn attach(&self, alarm: Option<Arc<dyn Alarm>>) {
        *self
            .shared
            .attached_to
            .lock()
            .unwrap_or_else(PoisonError::into_inner) = alarm;
    }

    /// SeqCst: pairs with the store in `wake`.
    pub(crate) fn is_woken(&self) -> bool {
        self.shared.woken.load(SeqCst)
    }

    /// Takes a pending wake-up.
    pub(crate) fn take(&self) -> bool {
        let woken = self.is_woken() && self.shared.woken.swap(false, SeqCst);
        if woken {
            self.shared.event.clear();
        }
        woken
    }

    pub(crate) fn event(&self) -> &Event {
        &self.shared.event
    }
}

impl fmt::Debug for Waker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Waker")
            .field("woken", &self.is_woken())
            .finish_non_exhaustive()
    }
}
