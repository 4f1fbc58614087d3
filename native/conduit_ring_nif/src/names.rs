//! Looks after the names of all topics that this VM publishes, also while nothing is published. One thread, which is there
//! as long as there is a publisher.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use conduit_ring::Error;
use rustler::{Encoder, Env, LocalPid, OwnedEnv, ResourceArc, Term};

use crate::publisher::{self, Looked, PublisherResource};
use crate::terms::{atoms, failure};

/// Shorter than the time after which publishing looks by itself, on a scheduler.
const LOOKS: Duration = Duration::from_millis(200);

/// The publishers that are looked after, and whether the thread is there.
static WATCHED: Mutex<(Vec<Watched>, bool)> = Mutex::new((Vec::new(), false));

struct Watched {
    publisher: ResourceArc<PublisherResource>,
    owner: LocalPid,
    topic: String,
    renewals: u64,
    lost: bool,
}

/// Looks after a publisher's name until it is closed, and tells its owner of what happens.
pub fn watch(publisher: ResourceArc<PublisherResource>, owner: LocalPid, topic: &str) {
    let watched = Watched {
        publisher,
        owner,
        topic: topic.to_owned(),
        renewals: 0,
        lost: false,
    };
    let mut all = lock();
    all.0.push(watched);
    if !all.1 {
        // Without a thread each publisher still looks by itself when it publishes.
        let thread = std::thread::Builder::new()
            .name("bb_ring_names".into())
            .stack_size(64 * 1024);
        all.1 = thread.spawn(run).is_ok();
    }
}

fn run() {
    loop {
        std::thread::sleep(LOOKS);
        let mut watched = std::mem::take(&mut lock().0);
        watched.retain_mut(Watched::look);
        let mut all = lock();
        all.0.append(&mut watched);
        if all.0.is_empty() {
            all.1 = false;
            return;
        }
    }
}

fn lock() -> std::sync::MutexGuard<'static, (Vec<Watched>, bool)> {
    WATCHED.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Watched {
    /// Whether there is something to look after.
    fn look(&mut self) -> bool {
        match publisher::look_after(&self.publisher) {
            Looked::Gone => return false,
            Looked::Busy => {}
            Looked::Well(renewals) => {
                self.lost = false;
                if renewals != self.renewals {
                    self.renewals = renewals;
                    self.tell(|_env| None);
                }
            }
            Looked::Lost if self.lost => {}
            Looked::Lost => {
                self.lost = true;
                let words = publisher::with_trouble(&self.publisher, |error| self.tell_of(error));
                self.lost = words.is_some();
            }
        }
        true
    }

    fn tell_of(&self, error: &Error) {
        self.tell(|env| Some(failure(env, error)));
    }

    /// An owner that is gone needs no word.
    fn tell(&self, trouble: impl for<'a> FnOnce(Env<'a>) -> Option<Term<'a>>) {
        let _ = OwnedEnv::new().send_and_clear(&self.owner, |env| {
            let news = trouble(env).unwrap_or_else(|| atoms::renewed().to_term(env));
            (atoms::bb_ring_publisher(), &self.topic, news).encode(env)
        });
    }
}
