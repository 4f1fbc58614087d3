//! Waking one's own subscriber from another thread.

use std::fmt;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Mutex, PoisonError};

use crate::memory::Memory;
use crate::os::Event;
use crate::writer;

/// Makes a subscriber's current [`wait`](crate::Subscriber::wait), or its next one, return
/// [`Wait::Woken`](crate::Wait::Woken) at once.
#[derive(Clone)]
pub struct Waker {
    shared: Arc<Shared>,
}

/// What wakes those who sleep on a segment.
pub(crate) trait Alarm: Send + Sync {
    fn ring(&self);
}

impl Alarm for Memory {
    fn ring(&self) {
        writer::notify_all(self);
    }
}

struct Shared {
    woken: AtomicBool,
    event: Event,
    /// Where the subscriber sleeps when it is attached. Set before it looks at `woken` for the last time.
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

    /// Wakes the subscriber, whatever it sleeps on. Any number of wake-ups before it looks are one.
    pub fn wake(&self) {
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

    pub(crate) fn attach(&self, alarm: Option<Arc<dyn Alarm>>) {
        *self
            .shared
            .attached_to
            .lock()
            .unwrap_or_else(PoisonError::into_inner) = alarm;
    }

    pub(crate) fn is_woken(&self) -> bool {
        self.shared.woken.load(SeqCst)
    }

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
