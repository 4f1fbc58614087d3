//! The options of a subscriber.

use conduit_ring::{Guard, Policy, Start, SubscriberOptions};

use crate::failure::Failure;
use crate::pointer;
use crate::version;

/// `start`: messages published from now on.
pub const CONDUIT_RING_START_NEW: u32 = 0;
/// `start`: the newest message in the ring, then new ones.
pub const CONDUIT_RING_START_LATEST: u32 = 1;
/// `start`: the last `history` messages in the ring, then new ones.
pub const CONDUIT_RING_START_HISTORY: u32 = 2;

/// `policy`: all messages that are still in the ring, in order.
pub const CONDUIT_RING_POLICY_ALL: u32 = 0;
/// `policy`: only the newest message.
pub const CONDUIT_RING_POLICY_LATEST: u32 = 1;

/// `guard`: read guarded if the file belongs to another user.
pub const CONDUIT_RING_GUARD_AUTO: u32 = 0;
/// `guard`: always read guarded.
pub const CONDUIT_RING_GUARD_ALWAYS: u32 = 1;
/// `guard`: never read guarded.
pub const CONDUIT_RING_GUARD_NEVER: u32 = 2;

/// The options of a subscriber.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct conduit_ring_subscriber_options {
    /// The version of the header.
    pub abi_version: u32,
    /// One of the `CONDUIT_RING_START_` constants.
    pub start: u32,
    /// The number of messages for `CONDUIT_RING_START_HISTORY`.
    pub history: u32,
    /// One of the `CONDUIT_RING_POLICY_` constants.
    pub policy: u32,
    /// One of the `CONDUIT_RING_GUARD_` constants.
    pub guard: u32,
}

pub(crate) fn policy(value: u32) -> Result<Policy, Failure> {
    match value {
        CONDUIT_RING_POLICY_ALL => Ok(Policy::All),
        CONDUIT_RING_POLICY_LATEST => Ok(Policy::Latest),
        _ => Err(Failure::invalid(format!(
            "invalid policy: expected CONDUIT_RING_POLICY_ALL or _LATEST, got: {value}"
        ))),
    }
}

fn start(value: u32, history: u32) -> Result<Start, Failure> {
    match value {
        CONDUIT_RING_START_NEW => Ok(Start::New),
        CONDUIT_RING_START_LATEST => Ok(Start::Latest),
        CONDUIT_RING_START_HISTORY => Ok(Start::History(history)),
        _ => Err(Failure::invalid(format!(
            "invalid start: expected CONDUIT_RING_START_NEW, _LATEST or _HISTORY, got: {value}"
        ))),
    }
}

fn guard(value: u32) -> Result<Guard, Failure> {
    match value {
        CONDUIT_RING_GUARD_AUTO => Ok(Guard::Auto),
        CONDUIT_RING_GUARD_ALWAYS => Ok(Guard::Always),
        CONDUIT_RING_GUARD_NEVER => Ok(Guard::Never),
        _ => Err(Failure::invalid(format!(
            "invalid guard: expected CONDUIT_RING_GUARD_AUTO, _ALWAYS or _NEVER, got: {value}"
        ))),
    }
}

/// Reads the options.
///
/// # Safety
/// `options` is null or points to options.
pub(crate) unsafe fn read(
    options: *const conduit_ring_subscriber_options,
) -> Result<SubscriberOptions, Failure> {
    if options.is_null() {
        return Ok(SubscriberOptions::default());
    }
    // SAFETY: each version of the options starts with its version.
    let abi_version = *unsafe { pointer::shared(options.cast::<u32>(), "options") }?;
    version::check(abi_version, "options")?;
    // SAFETY: the options have this version.
    let options = unsafe { pointer::shared(options, "options") }?;
    Ok(SubscriberOptions {
        start: start(options.start, options.history)?,
        policy: policy(options.policy)?,
        guard: guard(options.guard)?,
    })
}
