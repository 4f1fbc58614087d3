//! Looks after publishers while they are silent.
//!
//! A publisher that publishes looks by itself whether its topic's name still leads to its file. One that may be silent for
//! longer has [`Publisher::look_after`](crate::Publisher::look_after) called, in a loop of its owner's or by a thread from
//! here, for owners that have no loop: the bindings of other languages.

use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::os;
use crate::owner::Owner;

/// Between two looks: with those of publishing, a name that is lost is noticed well within a second.
const LOOKS: Duration = Duration::from_millis(250);
const STACK_BYTES: usize = 128 * 1024;

/// A thread that looks after something, and ends when this is dropped. It gets no signals. A child after `fork` has no such
/// thread.
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
    /// Calls `look` four times a second until it returns `false`. The thread runs when this returns: what its start
    /// allocates, a child that is forked next does not find locked.
    ///
    /// # Errors
    /// When no thread can be had. A publisher is looked after when it publishes then, and only then.
    pub fn start(mut look: impl FnMut() -> bool + Send + 'static) -> io::Result<Upkeep> {
        let life = Arc::new(Life::default());
        let own = life.clone();
        let run = move || {
            own.enter(Stage::Running);
            while !own.ends_within(LOOKS) && look() {}
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
        let goes_on = |stage: &mut Stage| *stage != Stage::Ending;
        let waited = self.news.wait_timeout_while(self.stage(), time, goes_on);
        *waited.unwrap_or_else(PoisonError::into_inner).0 == Stage::Ending
    }
}

impl Drop for Upkeep {
    fn drop(&mut self) {
        let thread = self.thread.take();
        if self.owner.is_here() {
            self.life.enter(Stage::Ending);
            // A look that panicked has said so.
            let _ = thread.map(JoinHandle::join);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    #[test]
    fn it_looks_until_there_is_nothing_to_look_after_and_gets_no_signals() {
        let (tell, told) = mpsc::channel();
        let mut looks = 0;
        let _upkeep = Upkeep::start(move || {
            looks += 1;
            tell.send(os::receives_signals()).unwrap();
            looks < 2
        });
        assert!(os::receives_signals());
        assert_eq!(told.iter().collect::<Vec<_>>(), [false, false]);
    }

    #[test]
    fn it_has_ended_when_it_is_dropped() {
        let (tell, told) = mpsc::channel();
        let upkeep = Upkeep::start(move || tell.send(()).is_ok()).unwrap();
        told.recv().unwrap();
        drop(upkeep);
        while told.try_recv().is_ok() {}
        assert_eq!(told.try_recv(), Err(mpsc::TryRecvError::Disconnected));
    }
}
