//! The reading end of a topic as a resource, and the thread behind it, which alone touches the ring.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

use conduit_ring::{
    ContentTag, Error, Guard, Lease, Meta, Policy, Received, Start, Subscriber, SubscriberOptions,
    Topic, Waker,
};
use rustler::env::SavedTerm;
use rustler::{
    Atom, Encoder, Env, LocalPid, Monitor, NifMap, NifResult, NifTaggedEnum, NifUnitEnum, OwnedEnv,
    Reference, Resource, ResourceArc, Term,
};

use crate::buffer::Buffer;
use crate::demand::{Active, Demand, Next, Request};
use crate::terms::{self, atoms, failure};

/// Reading needs little: the deepest call is a system call under a few small frames.
const STACK_SIZE: usize = 128 * 1024;
/// How long the thread sleeps at most before it looks around; every request wakes it at once.
const LONGEST_SLEEP: Duration = Duration::from_millis(500);

/// See the module.
pub struct SubscriberResource(Shared);

/// What the callers and the thread share.
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    waker: Waker,
    last_request: AtomicU64,
}

#[derive(Default)]
struct State {
    demand: Demand<Wanted>,
    closing: bool,
    /// Who is told when the thread has let go of the ring.
    closers: Vec<LocalPid>,
    ended: bool,
}

struct Wanted {
    from: LocalPid,
    kind: Kind,
}

#[derive(Clone, Copy, Debug, NifUnitEnum)]
enum Kind {
    /// The next message, as soon as there is one.
    Next,
    /// The newest message, or the word that there is none.
    Latest,
    /// As `Latest`, without a copy.
    Frame,
}

#[rustler::resource_impl]
impl Resource for SubscriberResource {
    const IMPLEMENTS_DOWN: bool = true;

    /// The owner died.
    fn down<'a>(&'a self, _env: Env<'a>, _pid: LocalPid, _monitor: Monitor) {
        self.0.close(None);
    }
}

impl Shared {
    fn new(waker: Waker) -> Self {
        Self {
            state: Mutex::default(),
            changed: Condvar::new(),
            waker,
            last_request: AtomicU64::new(0),
        }
    }

    /// Never held across anything that waits.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Changes the state and gets the thread to look at it, wherever it sleeps.
    fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let result = change(&mut self.lock());
        self.changed.notify_one();
        self.waker.wake();
        result
    }

    /// Asks the thread to end. False when it has ended, so that nobody will be told.
    fn close(&self, closer: Option<LocalPid>) -> bool {
        self.change(|state| {
            state.closing = true;
            state.closers.extend(closer);
            !state.ended
        })
    }

    /// What to do next; sleeps while nobody asks for anything. Nothing when it is time to end.
    fn next(&self) -> Option<Next<Wanted>> {
        let mut state = self.lock();
        loop {
            if state.closing {
                return None;
            }
            match state.demand.next() {
                Next::Park => {
                    state = self
                        .changed
                        .wait(state)
                        .unwrap_or_else(|poisoned| poisoned.into_inner())
                }
                next => return Some(next),
            }
        }
    }
}

#[derive(NifMap)]
struct OpenOptions {
    start: StartTerm,
    policy: PolicyTerm,
    guard: GuardTerm,
    content: Option<String>,
    untagged: bool,
}

/// Which topics' messages the owner takes. An encoding's name, and whether a topic that names none will do.
struct Expected {
    content: Option<ContentTag>,
    untagged: bool,
}

impl Expected {
    fn of(options: &OpenOptions) -> Self {
        Self {
            content: options.content.as_deref().map(ContentTag::of),
            untagged: options.untagged,
        }
    }

    /// What is there instead of what is expected. A topic that is not there yet may be anything.
    fn other(&self, ring: &Subscriber) -> Option<ContentTag> {
        let found = ring.content()?;
        let expected = self.content?;
        let accepted = found == expected || (self.untagged && found == ContentTag::RAW);
        (!accepted).then_some(found)
    }
}

#[derive(NifTaggedEnum)]
enum StartTerm {
    New,
    Latest,
    History(u32),
}

#[derive(NifUnitEnum)]
enum PolicyTerm {
    All,
    Latest,
}

#[derive(NifUnitEnum)]
enum GuardTerm {
    Auto,
    Always,
    Never,
}

impl From<OpenOptions> for SubscriberOptions {
    fn from(options: OpenOptions) -> Self {
        Self {
            start: match options.start {
                StartTerm::New => Start::New,
                StartTerm::Latest => Start::Latest,
                StartTerm::History(count) => Start::History(count),
            },
            policy: match options.policy {
                PolicyTerm::All => Policy::All,
                PolicyTerm::Latest => Policy::Latest,
            },
            guard: match options.guard {
                GuardTerm::Auto => Guard::Auto,
                GuardTerm::Always => Guard::Always,
                GuardTerm::Never => Guard::Never,
            },
        }
    }
}

#[derive(NifTaggedEnum)]
enum ActiveTerm {
    Always,
    Once,
    More(i64),
    Never,
}

impl From<ActiveTerm> for Active {
    fn from(active: ActiveTerm) -> Self {
        match active {
            ActiveTerm::Always => Active::Always,
            ActiveTerm::Once => Active::Once,
            ActiveTerm::More(more) => Active::More(more),
            ActiveTerm::Never => Active::Never,
        }
    }
}

#[rustler::nif(schedule = "DirtyIo")]
fn subscriber_open<'a>(
    env: Env<'a>,
    topic: &str,
    reference: Reference<'a>,
    options: OpenOptions,
) -> NifResult<Term<'a>> {
    let expected = Expected::of(&options);
    let options = SubscriberOptions::from(options);
    let ring = match Topic::found(topic).and_then(|topic| Subscriber::open(&topic, &options)) {
        Ok(ring) => ring,
        Err(error) => return Ok(failure(env, &error)),
    };
    if let Some(other) = expected.other(&ring) {
        return Ok(terms::other_content(env, other));
    }
    let owner = env.pid();
    let resource = ResourceArc::new(SubscriberResource(Shared::new(ring.waker())));
    let reader = Reader {
        ring,
        policy: options.policy,
        resource: resource.clone(),
        post: Post::new(owner, reference),
        last_error: None,
        expected,
        refused: None,
    };
    let thread = std::thread::Builder::new()
        .name("bb_ring".into())
        .stack_size(STACK_SIZE);
    if let Err(error) = thread.spawn(move || reader.run()) {
        return Ok(terms::error(env, (atoms::thread(), error.to_string())));
    }
    if resource.monitor(Some(env), &owner).is_none() {
        resource.0.close(None);
    }
    Ok(terms::ok(env, resource))
}

/// Sets the mode; `:passive` when that took the last credit back.
#[rustler::nif]
fn subscriber_active(resource: ResourceArc<SubscriberResource>, active: ActiveTerm) -> Atom {
    resource.0.change(|state| {
        if state.closing {
            atoms::closed()
        } else if state.demand.set(active.into()) {
            atoms::passive()
        } else {
            rustler::types::atom::ok()
        }
    })
}

/// Asks for one message on behalf of the caller: `{:ok, id}`, and the answer comes as `{:bb_ring_reply, ref, id, result}`.
#[rustler::nif]
fn subscriber_request<'a>(
    env: Env<'a>,
    resource: ResourceArc<SubscriberResource>,
    kind: Kind,
) -> Term<'a> {
    let shared = &resource.0;
    let id = shared.last_request.fetch_add(1, Ordering::Relaxed);
    let request = Request {
        id,
        what: Wanted {
            from: env.pid(),
            kind,
        },
    };
    let refused = shared.change(|state| match state {
        State { closing: true, .. } => Some(atoms::closed()),
        State { demand, .. } if demand.is_active() && matches!(kind, Kind::Next) => {
            Some(atoms::active())
        }
        State { demand, .. } => {
            demand.request(request);
            None
        }
    });
    refused.map_or_else(|| terms::ok(env, id), |reason| terms::error(env, reason))
}

/// Takes a request back: true when no answer will come; false when one comes or has come.
#[rustler::nif]
fn subscriber_cancel(resource: ResourceArc<SubscriberResource>, id: u64) -> bool {
    resource.0.change(|state| state.demand.cancel(id))
}

/// True when `{:bb_ring_closed, ref}` will come to the caller, once the ring is let go; false when that has happened.
#[rustler::nif]
fn subscriber_close(env: Env, resource: ResourceArc<SubscriberResource>) -> bool {
    resource.0.close(Some(env.pid()))
}

/// The thread: takes messages from the ring and sends them on.
struct Reader {
    ring: Subscriber,
    policy: Policy,
    /// As a port, a subscription lives until its owner dies or closes it, whoever refers to it.
    resource: ResourceArc<SubscriberResource>,
    post: Post,
    last_error: Option<String>,
    expected: Expected,
    /// The content that the owner was last told of as another one.
    refused: Option<ContentTag>,
}

impl Reader {
    fn run(mut self) {
        while let Some(next) = self.resource.0.next() {
            match next {
                Next::Answer(Request {
                    id,
                    what:
                        Wanted {
                            from,
                            kind: Kind::Latest,
                        },
                }) => self.answer_latest(from, id),
                Next::Answer(Request {
                    id,
                    what:
                        Wanted {
                            from,
                            kind: Kind::Frame,
                        },
                }) => self.answer_frame(from, id),
                Next::Answer(request) => self.answer(request),
                Next::Deliver => self.deliver(),
                Next::Park => {}
            }
        }
        let Self {
            ring,
            resource,
            mut post,
            ..
        } = self;
        drop(ring);
        let mut state = resource.0.lock();
        state.ended = true;
        for request in state.demand.drain() {
            post.answer(&request.what.from, request.id, Err(atoms::closed()));
        }
        for closer in &state.closers {
            post.closed(closer);
        }
    }

    fn deliver(&mut self) {
        let Some((meta, data)) = self.read() else {
            return self.sleep();
        };
        // Counted before it is sent: its receiver may ask for the next one at once.
        let passive = self.resource.0.lock().demand.delivered();
        self.post.message(meta, data);
        if passive {
            self.post.passive();
        }
    }

    fn answer(&mut self, request: Request<Wanted>) {
        if let Some((meta, data)) = self.read() {
            return self
                .post
                .answer(&request.what.from, request.id, Ok((meta, data)));
        }
        let cancelled = self.resource.0.lock().demand.postpone(request);
        match cancelled {
            Some(request) => {
                self.post
                    .answer(&request.what.from, request.id, Err(atoms::timeout()))
            }
            None => self.sleep(),
        }
    }

    fn answer_latest(&mut self, from: LocalPid, id: u64) {
        self.ring.set_policy(Policy::Latest);
        let result = self.read().ok_or_else(atoms::empty);
        self.ring.set_policy(self.policy);
        self.post.answer(&from, id, result);
    }

    fn answer_frame(&mut self, from: LocalPid, id: u64) {
        self.ring.set_policy(Policy::Latest);
        let lease = self.lease();
        self.ring.set_policy(self.policy);
        self.post.lend(&from, id, lease);
    }

    fn lease(&mut self) -> Result<Lease, Atom> {
        loop {
            match self.ring.try_lease() {
                Ok(Received::Message(_meta, _lease)) if self.refuses() => {}
                Ok(Received::Message(_meta, lease)) => return Ok(lease),
                Ok(Received::Nothing) => return Err(atoms::empty()),
                Ok(Received::PublisherUp) => self.post.event(atoms::publisher_up()),
                Ok(Received::PublisherDown) => self.post.event(atoms::publisher_down()),
                Err(Error::TooManyLeases { .. }) => return Err(atoms::too_many_leases()),
                Err(error) => {
                    self.report(&error);
                    return Err(atoms::empty());
                }
            }
        }
    }

    /// The next message, if there is one now. What else the ring has to say goes to the owner.
    fn read(&mut self) -> Option<(Meta, Buffer)> {
        loop {
            match self.ring.try_read_with(Buffer::with_len) {
                Ok(Received::Message(_meta, _data)) if self.refuses() => {}
                Ok(Received::Message(meta, data)) => return Some((meta, data)),
                Ok(Received::Nothing) => return None,
                Ok(Received::PublisherUp) => self.post.event(atoms::publisher_up()),
                Ok(Received::PublisherDown) => self.post.event(atoms::publisher_down()),
                Err(error) => {
                    self.report(&error);
                    return None;
                }
            }
        }
    }

    /// Whether the topic has another content than the owner takes, which it is told once. What is read of it goes nowhere.
    fn refuses(&mut self) -> bool {
        let other = self.expected.other(&self.ring);
        if let Some(other) = other
            && self.refused != Some(other)
        {
            self.post.other_content(other);
        }
        self.refused = other;
        other.is_some()
    }

    /// A topic of another content is told before its first message comes.
    fn sleep(&mut self) {
        self.refuses();
        if let Err(error) = self.ring.wait(LONGEST_SLEEP) {
            self.report(&error);
            self.pause();
        }
    }

    /// Trouble of the system's (no free reader slot, a file that is no ring) is told once, and the next try follows after a while.
    fn report(&mut self, error: &conduit_ring::Error) {
        let text = error.to_string();
        if self.last_error.as_ref() != Some(&text) {
            self.post.error(error);
            self.last_error = Some(text);
        }
    }

    /// A wait that fails at once must not become a busy loop.
    fn pause(&self) {
        let state = self.resource.0.lock();
        let _ = self.resource.0.changed.wait_timeout(state, LONGEST_SLEEP);
    }
}

/// Sends terms to the owner and to callers. One environment is filled and emptied again for each message.
struct Post {
    owner: LocalPid,
    env: OwnedEnv,
    reference: SavedTerm,
    reference_env: OwnedEnv,
}

impl Post {
    fn new(owner: LocalPid, reference: Reference) -> Self {
        let reference_env = OwnedEnv::new();
        let reference = reference_env.save(reference);
        Self {
            owner,
            env: OwnedEnv::new(),
            reference,
            reference_env,
        }
    }

    fn message(&mut self, meta: Meta, data: Buffer) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            (atoms::bb_ring(), reference, terms::message(env, meta, data)).encode(env)
        });
    }

    fn event(&mut self, event: Atom) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            (atoms::bb_ring(), reference, event).encode(env)
        });
    }

    fn error(&mut self, error: &conduit_ring::Error) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            (atoms::bb_ring(), reference, failure(env, error)).encode(env)
        });
    }

    fn other_content(&mut self, found: ContentTag) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            let refusal = terms::other_content(env, found);
            (atoms::bb_ring(), reference, refusal).encode(env)
        });
    }

    fn passive(&mut self) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            (atoms::bb_ring_passive(), reference).encode(env)
        });
    }

    fn closed(&mut self, closer: &LocalPid) {
        self.send(closer, |env, reference| {
            (atoms::bb_ring_closed(), reference).encode(env)
        });
    }

    fn answer(&mut self, to: &LocalPid, id: u64, result: Result<(Meta, Buffer), Atom>) {
        self.send(to, |env, reference| {
            let result = match result {
                Ok((meta, data)) => terms::ok(env, terms::message(env, meta, data)),
                Err(reason) => terms::error(env, reason),
            };
            (atoms::bb_ring_reply(), reference, id, result).encode(env)
        });
    }

    fn lend(&mut self, to: &LocalPid, id: u64, lease: Result<Lease, Atom>) {
        self.send(to, |env, reference| {
            let result = match lease {
                Ok(lease) => terms::ok(env, terms::frame(env, lease)),
                Err(reason) => terms::error(env, reason),
            };
            (atoms::bb_ring_reply(), reference, id, result).encode(env)
        });
    }

    /// A receiver that is gone wants nothing: its death ends the subscription by the monitor.
    fn send(&mut self, to: &LocalPid, build: impl for<'a> FnOnce(Env<'a>, Term<'a>) -> Term<'a>) {
        let Self {
            env,
            reference,
            reference_env,
            ..
        } = self;
        let _ = env.send_and_clear(to, |env| {
            let reference = reference_env.run(|own| reference.load(own).in_env(env));
            build(env, reference)
        });
    }
}
