//! The wish that a program ends, and those who wait for it.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::io::{self, Read};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Instant;

type Waker = Box<dyn Fn() + Send>;

#[derive(Default)]
struct State {
    requested: bool,
    wakers: Vec<Waker>,
}

/// A stop that anyone may request, once and for all. Clones share it.
///
/// ```
/// use program::stop::Stop;
/// use std::time::{Duration, Instant};
///
/// let stop = Stop::new();
/// assert!(!stop.wait_until(Instant::now() + Duration::from_millis(1)));
/// stop.request();
/// assert!(stop.wait_until(Instant::now() + Duration::from_secs(3600)));
/// ```
#[derive(Clone, Default)]
pub struct Stop {
    shared: Arc<(Mutex<State>, Condvar)>,
}

impl Stop {
    /// A stop that nobody has requested.
    pub fn new() -> Stop {
        Stop::default()
    }

    /// A program's stop: requested by SIGTERM and SIGINT, and by the end of stdin if `with_stdin`.
    pub fn of_process(with_stdin: bool) -> io::Result<Stop> {
        let stop = Stop::new();
        stop.request_on_signals()?;
        if with_stdin {
            stop.request_when_stdin_ends()?;
        }
        Ok(stop)
    }

    fn request_on_signals(&self) -> io::Result<()> {
        let mut signals = Signals::new([SIGTERM, SIGINT])?;
        let stop = self.clone();
        spawn("signals", move || {
            signals.forever().for_each(|_| stop.request());
        })
    }

    fn request_when_stdin_ends(&self) -> io::Result<()> {
        let stop = self.clone();
        spawn("stdin", move || {
            drain(io::stdin().lock());
            stop.request();
        })
    }

    /// Requests it and wakes all who wait.
    pub fn request(&self) {
        let mut state = self.state();
        state.requested = true;
        state.wakers.iter().for_each(|wake| wake());
        self.shared.1.notify_all();
    }

    /// Whether it was requested.
    pub fn requested(&self) -> bool {
        self.state().requested
    }

    /// Waits until it is requested (`true`) or `deadline` has come (`false`).
    pub fn wait_until(&self, deadline: Instant) -> bool {
        let mut state = self.state();
        while !state.requested {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            let waited = self.shared.1.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }

    /// Has `wake` called at each request, and now if it was requested already: for threads that wait for something
    /// else. It must not call this stop.
    pub fn wakes(&self, wake: impl Fn() + Send + 'static) {
        let mut state = self.state();
        if state.requested {
            wake();
        }
        state.wakers.push(Box::new(wake));
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> io::Result<()> {
    let thread = thread::Builder::new().name(name.into());
    thread.stack_size(64 * 1024).spawn(body).map(drop)
}

/// Reads to the end; an error is an end too.
fn drain(mut source: impl Read) {
    let mut scratch = [0; 512];
    loop {
        match source.read(&mut scratch) {
            Ok(0) => return,
            Err(error) if error.kind() != io::ErrorKind::Interrupted => return,
            _ => {}
        }
    }
}
