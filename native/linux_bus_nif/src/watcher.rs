//! The thread that serves all open lines: it passes on edges and closes abandoned lines. It starts
//! when the first lines are opened and never stops.
//!
//! The kernel has stamped an edge when it happened. `edges.rs` passes on this timestamp, so that a
//! late thread makes no edge late.
//!
//! Closing a line may take as long as a transfer on its chip's bus. So this thread does it for a
//! dead process or a collected handle, instead of a scheduler.

use std::collections::HashMap;
use std::fs::File;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};

use nix::errno::Errno as Failure;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::eventfd::{EfdFlags, EventFd};
use rustler::OwnedEnv;

use crate::errno::Result;

static WATCHER: OnceLock<Arc<Watcher>> = OnceLock::new();
static STARTING: Mutex<()> = Mutex::new(());

/// The number of the wake-up event, which no lines have.
const WAKE: u64 = 0;
const EVENTS: usize = 16;

/// Lines that the watcher serves.
pub trait Watched: Send + Sync {
    /// Returns whether the lines include the line `offset` of a chip.
    fn includes(&self, chip: &str, offset: u32) -> bool;
    /// Delivers the buffered edges. Stops listening when the receiver or the chip is gone.
    fn deliver_edges(&self, message: &mut OwnedEnv);
    /// Closes the lines. Has no effect on closed lines.
    fn close(&self);
}

/// The thread's state, shared with its callers.
pub struct Watcher {
    epoll: Epoll,
    wake: EventFd,
    next: AtomicU64,
    /// All open lines by their number.
    open: Mutex<HashMap<u64, Weak<dyn Watched>>>,
    abandoned: Mutex<Vec<Arc<dyn Watched>>>,
}

impl Watcher {
    /// Returns the watcher. Starts its thread on the first call.
    pub fn started() -> Result<&'static Arc<Self>> {
        let _starting = lock(&STARTING);
        if let Some(watcher) = WATCHER.get() {
            return Ok(watcher);
        }
        let watcher = Arc::new(Self::new()?);
        let thread = watcher.clone();
        std::thread::Builder::new()
            .name("bb_gpio".into())
            .spawn(move || thread.run())?;
        Ok(WATCHER.get_or_init(|| watcher))
    }

    fn new() -> Result<Self> {
        let epoll = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?;
        let wake = EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)?;
        epoll.add(&wake, EpollEvent::new(EpollFlags::EPOLLIN, WAKE))?;
        Ok(Self {
            epoll,
            wake,
            next: AtomicU64::new(WAKE + 1),
            open: Mutex::new(HashMap::new()),
            abandoned: Mutex::new(Vec::new()),
        })
    }

    /// Registers the lines that `create` returns for a new number.
    pub fn register<T: Watched + 'static>(&self, create: impl FnOnce(u64) -> T) -> Arc<T> {
        let id = self.next.fetch_add(1, Ordering::Relaxed);
        let lines = Arc::new(create(id));
        let watched: Arc<dyn Watched> = lines.clone();
        lock(&self.open).insert(id, Arc::downgrade(&watched));
        lines
    }

    /// Removes lines that are dropped.
    pub fn unregister(&self, id: u64) {
        lock(&self.open).remove(&id);
    }

    /// Returns all open lines that include the line `offset` of a chip.
    pub fn including(&self, chip: &str, offset: u32) -> Vec<Arc<dyn Watched>> {
        let open: Vec<_> = lock(&self.open)
            .values()
            .filter_map(Weak::upgrade)
            .collect();
        open.into_iter()
            .filter(|lines| lines.includes(chip, offset))
            .collect()
    }

    /// Lets the thread close lines, without waiting.
    pub fn abandon(&self, lines: Arc<dyn Watched>) {
        lock(&self.abandoned).push(lines);
        // Fails only if the counter is full, and then the thread is awake.
        let _ = self.wake.write(1);
    }

    /// Starts calling [`Watched::deliver_edges`] when edges arrive.
    pub fn watch(&self, file: &File, id: u64) -> Result<()> {
        Ok(self
            .epoll
            .add(file, EpollEvent::new(EpollFlags::EPOLLIN, id))?)
    }

    /// Stops calling [`Watched::deliver_edges`].
    pub fn unwatch(&self, file: &File) {
        // Fails if the file is not watched, which is the desired state.
        let _ = self.epoll.delete(file);
    }

    fn run(&self) {
        let mut message = OwnedEnv::new();
        let mut events = [EpollEvent::empty(); EVENTS];
        loop {
            match self.epoll.wait(&mut events, EpollTimeout::NONE) {
                Ok(count) => events[..count]
                    .iter()
                    .for_each(|event| self.handle(event.data(), &mut message)),
                Err(Failure::EINTR) => {}
                Err(_) => return,
            }
        }
    }

    fn handle(&self, id: u64, message: &mut OwnedEnv) {
        if id == WAKE {
            self.close_abandoned();
            return;
        }
        let lines = lock(&self.open).get(&id).and_then(Weak::upgrade);
        if let Some(lines) = lines {
            lines.deliver_edges(message);
        }
    }

    fn close_abandoned(&self) {
        let _ = self.wake.read();
        let abandoned = std::mem::take(&mut *lock(&self.abandoned));
        // Closes lines before it drops them, so that a caller of `including` waits for the end.
        for lines in abandoned {
            lines.close();
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
