//! Checks the names of all topics that this VM publishes, even while nothing is published. One
//! thread does so as long as there is a publisher.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use conduit_ring::Error;
use rustler::{Encoder, Env, LocalPid, OwnedEnv, ResourceArc, Term};

use crate::publication::{self, NameCheck, PublisherResource};
use crate::terms::{atoms, failure};

/// The pause between two checks, shorter than the interval at which publishing checks the name
/// itself, on a scheduler.
const CHECK_PERIOD: Duration = Duration::from_millis(200);

static WATCHED: Mutex<Watched> = Mutex::new(Watched {
    topics: Vec::new(),
    running: false,
});

/// The watched topics, and whether the thread runs.
struct Watched {
    topics: Vec<WatchedTopic>,
    running: bool,
}

struct WatchedTopic {
    publisher: ResourceArc<PublisherResource>,
    owner: LocalPid,
    topic: String,
    renewals: u64,
    lost: bool,
}

/// Checks the name of a publisher's topic until the publisher is closed. Notifies its owner when
/// the name is lost or the file created again.
pub fn watch(publisher: ResourceArc<PublisherResource>, owner: LocalPid, topic: &str) {
    let mut watched = lock();
    watched.topics.push(WatchedTopic {
        publisher,
        owner,
        topic: topic.to_owned(),
        renewals: 0,
        lost: false,
    });
    if !watched.running {
        // Without a thread each publisher still checks its name when it publishes.
        let thread = std::thread::Builder::new()
            .name("bb_ring_names".into())
            .stack_size(64 * 1024);
        watched.running = thread.spawn(run).is_ok();
    }
}

fn run() {
    loop {
        std::thread::sleep(CHECK_PERIOD);
        let mut topics = std::mem::take(&mut lock().topics);
        topics.retain_mut(WatchedTopic::check);
        let mut watched = lock();
        watched.topics.append(&mut topics);
        if watched.topics.is_empty() {
            watched.running = false;
            return;
        }
    }
}

fn lock() -> MutexGuard<'static, Watched> {
    WATCHED.lock().unwrap_or_else(PoisonError::into_inner)
}

impl WatchedTopic {
    /// Checks the name. Returns `false` when the publisher is closed.
    fn check(&mut self) -> bool {
        match publication::check_name(&self.publisher) {
            NameCheck::Closed => return false,
            NameCheck::Busy => {}
            NameCheck::Named(renewals) => {
                self.lost = false;
                if renewals != self.renewals {
                    self.renewals = renewals;
                    self.notify(|env| atoms::renewed().to_term(env));
                }
            }
            NameCheck::Lost if self.lost => {}
            NameCheck::Lost => {
                let notified =
                    publication::with_trouble(&self.publisher, |error| self.notify_lost(error));
                self.lost = notified.is_some();
            }
        }
        true
    }

    fn notify_lost(&self, error: &Error) {
        self.notify(|env| failure(env, error));
    }

    /// Sends the owner an event. Ignores an owner that is dead.
    fn notify(&self, event: impl for<'a> FnOnce(Env<'a>) -> Term<'a>) {
        let _ = OwnedEnv::new().send_and_clear(&self.owner, |env| {
            (atoms::bb_ring_publisher(), &self.topic, event(env)).encode(env)
        });
    }
}
