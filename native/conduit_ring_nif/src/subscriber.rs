//! The NIFs of a subscriber: the reading end of a topic as a resource.

use conduit_ring::{Guard, Policy, Start, Subscriber, SubscriberOptions, Topic};
use rustler::{
    Atom, Env, NifMap, NifResult, NifTaggedEnum, NifUnitEnum, Reference, ResourceArc, Term,
};

use crate::content::Expected;
use crate::demand::{Active, Request};
use crate::reader::Reader;
use crate::sender::Sender;
use crate::subscription::{Caller, Kind, Shared, State, SubscriberResource};
use crate::terms::{self, atoms, failure};

/// The stack of the thread. The deepest call is a system call under a few small frames.
const STACK_SIZE: usize = 128 * 1024;

#[derive(NifMap)]
struct OpenOptions {
    start: StartTerm,
    policy: PolicyTerm,
    guard: GuardTerm,
    content: Option<String>,
    untagged: bool,
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
    let expected = Expected::new(options.content.as_deref(), options.untagged);
    let options = SubscriberOptions::from(options);
    let ring = match Topic::found(topic).and_then(|topic| Subscriber::open(&topic, &options)) {
        Ok(ring) => ring,
        Err(error) => return Ok(failure(env, &error)),
    };
    if let Some(content) = expected.unexpected(&ring) {
        return Ok(terms::other_content(env, content));
    }
    let owner = env.pid();
    let resource = ResourceArc::new(SubscriberResource(Shared::new(ring.waker())));
    let reader = Reader {
        ring,
        policy: options.policy,
        resource: resource.clone(),
        sender: Sender::new(owner, reference),
        last_error: None,
        expected,
        rejected: None,
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

/// Sets the mode. Returns `:passive` when that took the last credit.
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

/// Requests one message for the caller. Returns `{:ok, id}`; the answer arrives as
/// `{:bb_ring_reply, ref, id, result}`.
#[rustler::nif]
fn subscriber_request<'a>(
    env: Env<'a>,
    resource: ResourceArc<SubscriberResource>,
    kind: Kind,
) -> Term<'a> {
    let shared = &resource.0;
    let id = shared.next_request();
    let request = Request {
        id,
        caller: Caller {
            pid: env.pid(),
            kind,
        },
    };
    let error = shared.change(|state| match state {
        State { closing: true, .. } => Some(atoms::closed()),
        State { demand, .. } if demand.is_active() && matches!(kind, Kind::Next) => {
            Some(atoms::active())
        }
        State { demand, .. } => {
            demand.request(request);
            None
        }
    });
    error.map_or_else(|| terms::ok(env, id), |reason| terms::error(env, reason))
}

/// Cancels a request. Returns `true` when no answer will follow, `false` when one arrives or has
/// arrived.
#[rustler::nif]
fn subscriber_cancel(resource: ResourceArc<SubscriberResource>, id: u64) -> bool {
    resource.0.change(|state| state.demand.cancel(id))
}

/// Closes the subscriber. Returns `true` when `{:bb_ring_closed, ref}` follows for the caller
/// once the ring is released, `false` when it is released already.
#[rustler::nif]
fn subscriber_close(env: Env, resource: ResourceArc<SubscriberResource>) -> bool {
    resource.0.close(Some(env.pid()))
}
