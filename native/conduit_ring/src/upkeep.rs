//! Checks the names of publishers while they are silent.
//!
//! A publisher that publishes checks by itself whether its topic's name still leads to its file.
//! A publisher that may be silent for longer needs calls of
//! [`Publisher::look_after`](crate::Publisher::look_after): in a loop of its owner's, or by a
//! thread from here, for owners without a loop, such as the bindings of other languages.
//!
//! ```
//! use std::sync::{Arc, Mutex};
//! use conduit_ring::{Publisher, PublisherOptions, Topic, upkeep::Upkeep};
//!
//! # let name = format!("doc-upkeep-{}", std::process::id());
//! let topic = Topic::new(&name)?;
//! let publisher = Publisher::open(&topic, &PublisherOptions::default())?;
//! let publisher = Arc::new(Mutex::new(publisher));
//! let upkeep = Upkeep::start({
//!     let publisher = publisher.clone();
//!     move || {
//!         // A failure is kept in Publisher::trouble, and the next call tries again.
//!         let _ = publisher.lock().unwrap().look_after();
//!         true
//!     }
//! })?;
//! // …
//! drop(upkeep); // ends the thread
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::os;
use crate::owner::Owner;

/// The time between two checks. A lost name is noticed well within a second.
const INTERVAL: Duration = Duration::from_millis(250);
const STACK_BYTES: usize = 128 * 1024;

/// A thread that checks something at intervals, and ends when this value is dropped.
///
/// The thread receives no signals, so that they reach the program's own threads. A child after
/// `fork` has no such thread, and dropping the value there does nothing.
#[derive(Debug)]
pub struct Upkeep {
    life: Arc<Life>,
    thread: Option<JoinHandle<()>>,
    owner: Owner,
}

#[derive(Debug, Default)]
struct Life {
    stage: Mutex<Stage>,
    news: Condvar,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    #[default]
    Starting,
    Running,
    Ending,
}

impl Upkeep {
    /// Calls `look` four times a second until it returns `false`.
    ///
    /// The thread runs when this function returns. So a child that is forked next does not
    /// inherit locks that starting a thread takes, such as the allocator's.
    ///
    /// # Errors
    /// Returns the operating system's error when it cannot start a thread. The publisher then
    /// checks its name only when it publishes.
    pub fn start(mut look: impl FnMut() -> bool + Send + 'static) -> io::Result<Upkeep> {
        let life = Arc::new(Life::default());
        let own = life.clone();
        let run = move || {
            own.enter(Stage::Running);
            while !own.ends_within(INTERVAL) && look() {}
        };
        let thread = Some(os::start_thread("conduit_ring", STACK_BYTES, run)?);
        let owner = Owner::here();
        life.await_start();
        Ok(Upkeep {
            life,
            thread,
            owner,
        })
    }
}

impl Life {
    fn stage(&self) -> MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn enter(&self, stage: Stage) {
        *self.stage() = stage;
        self.news.notify_all();
    }

    fn await_start(&self) {
        let starts = |stage: &mut Stage| *stage == Stage::Starting;
        drop(self.news.wait_while(self.stage(), starts));
    }

    fn ends_within(&self, time: Duration) -> bool {
        let continues = |stage: &mut Stage| *stage != Stage::Ending;
        let waited = self.news.wait_timeout_while(self.stage(), time, continues);
        *waited.unwrap_or_else(PoisonError::into_inner).0 == Stage::Ending
    }
}

impl Drop for Upkeep {
    fn drop(&mut self) {
        let thread = self.thread.take();
        if self.owner.is_here() {
            self.life.enter(Stage::Ending);
            // The panic of a check was printed by its thread.
            let _ = thread.map(JoinHandle::join);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[test]
    fn it_checks_until_the_check_says_stop_and_receives_no_signals() {
        let (sender, receiver) = mpsc::channel();
        let mut looks = 0;
        let _upkeep = Upkeep::start(move || {
            looks += 1;
            sender.send(os::receives_signals()).unwrap();
            looks < 2
        });
        assert!(os::receives_signals());
        assert_eq!(receiver.iter().collect::<Vec<_>>(), [false, false]);
    }

    #[test]
    fn its_thread_has_ended_when_it_is_dropped() {
        let (sender, receiver) = mpsc::channel();
        let upkeep = Upkeep::start(move || sender.send(()).is_ok()).unwrap();
        receiver.recv().unwrap();
        drop(upkeep);
        while receiver.try_recv().is_ok() {}
        assert_eq!(receiver.try_recv(), Err(mpsc::TryRecvError::Disconnected));
    }
}
