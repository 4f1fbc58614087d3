//! The one thread behind all lines: it passes edges on, and closes what nobody has any more. It
//! starts with the first lines that are opened, and stays.
//!
//! Closing a line may take as long as a transfer on the bus of its chip, so no scheduler does it for
//! a process that died or for a handle that was collected.

use std::collections::HashMap;
use std::fs::File;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};

use nix::errno::Errno as Failure;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::eventfd::{EfdFlags, EventFd};
use rustler::OwnedEnv;

use crate::errno::Result;
use crate::lines::Lines;

static WATCHER: OnceLock<Arc<Watcher>> = OnceLock::new();
static STARTING: Mutex<()> = Mutex::new(());

/// No lines have this number.
const WAKE: u64 = 0;
const EVENTS: usize = 16;

/// See the module.
pub struct Watcher {
    epoll: Epoll,
    wake: EventFd,
    next: AtomicU64,
    /// All lines that are open here, by their number.
    open: Mutex<HashMap<u64, Weak<Lines>>>,
    abandoned: Mutex<Vec<Arc<Lines>>>,
}

impl Watcher {
    /// The watcher, whose thread runs.
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

    /// Makes lines that have a number.
    pub fn register(&self, lines: impl FnOnce(u64) -> Lines) -> Arc<Lines> {
        let id = self.next.fetch_add(1, Ordering::Relaxed);
        let lines = Arc::new(lines(id));
        lock(&self.open).insert(id, Arc::downgrade(&lines));
        lines
    }

    /// Lines are closed, and nobody refers to them.
    pub fn forget(&self, id: u64) {
        lock(&self.open).remove(&id);
    }

    /// All lines here that have one of a chip among them.
    pub fn holders(&self, chip: &str, offset: u32) -> Vec<Arc<Lines>> {
        let open: Vec<_> = lock(&self.open)
            .values()
            .filter_map(Weak::upgrade)
            .collect();
        open.into_iter()
            .filter(|lines| lines.chip == chip && lines.offsets.contains(&offset))
            .collect()
    }

    /// Has lines closed, and waits for nothing.
    pub fn abandon(&self, lines: Arc<Lines>) {
        lock(&self.abandoned).push(lines);
        // It cannot fail but by a count that is full, and then the thread is awake.
        let _ = self.wake.write(1);
    }

    /// From now on [`Lines::pass_on`] is called when there are edges.
    pub fn watch(&self, file: &File, id: u64) -> Result<()> {
        Ok(self
            .epoll
            .add(file, EpollEvent::new(EpollFlags::EPOLLIN, id))?)
    }

    /// From now on it is not.
    pub fn ignore(&self, file: &File) {
        // What is not watched need not be ignored.
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
            lines.pass_on(message);
        }
    }

    fn close_abandoned(&self) {
        let _ = self.wake.read();
        let abandoned = std::mem::take(&mut *lock(&self.abandoned));
        // Closed before they are forgotten, so that who takes them over waits for it.
        for lines in abandoned {
            lines.close();
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
