//! A stop request that several threads can wait for.

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

/// A stop that any thread may request, once. Clones share it.
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
    /// Returns a stop that is not requested yet.
    pub fn new() -> Stop {
        Stop::default()
    }

    /// Returns the stop of this process. SIGTERM and SIGINT request it, and so does the end of
    /// stdin if `with_stdin` is true.
    ///
    /// # Errors
    /// The operating system's error when a signal handler cannot be installed or a thread cannot
    /// be started.
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

    /// Requests the stop and wakes all waiting threads.
    pub fn request(&self) {
        let mut state = self.state();
        state.requested = true;
        state.wakers.iter().for_each(|wake| wake());
        self.shared.1.notify_all();
    }

    /// Returns whether the stop was requested.
    pub fn requested(&self) -> bool {
        self.state().requested
    }

    /// Waits for the request. Returns `true` when it came and `false` at `deadline`.
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

    /// Registers `wake`, which every request calls; it runs at once if the stop was requested
    /// already. For threads that wait for something else. `wake` must not call this stop.
    pub fn on_request(&self, wake: impl Fn() + Send + 'static) {
        let mut state = self.state();
        if state.requested {
            wake();
        }
        state.wakers.push(Box::new(wake));
    }

    /// The former name of [`Stop::on_request`].
    #[deprecated(note = "use on_request")]
    pub fn wakes(&self, wake: impl Fn() + Send + 'static) {
        self.on_request(wake);
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> io::Result<()> {
    let thread = thread::Builder::new().name(name.into());
    thread.stack_size(64 * 1024).spawn(body).map(drop)
}

/// Reads to the end. An error counts as the end.
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
