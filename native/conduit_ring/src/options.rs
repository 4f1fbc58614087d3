//! How topics are published, read and watched.

use std::time::Duration;

use crate::content::ContentTag;
use crate::delivery::{Policy, Start};
use crate::geometry::Geometry;

/// How a topic is published.
///
/// ```
/// use conduit_ring::{ContentTag, Geometry, PublisherOptions};
///
/// let options = PublisherOptions {
///     geometry: Geometry::depth(4, 2_000_000)?,
///     content: ContentTag::of("conduit/frame"),
///     ..Default::default()
/// };
/// assert_eq!(options.mode, 0o660);
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublisherOptions {
    /// Number and length of the slots.
    pub geometry: Geometry,
    /// The encoding of the messages.
    pub content: ContentTag,
    /// Permissions of the file, whatever the umask is. A file that is taken over keeps its own
    /// permissions and its group.
    pub mode: u32,
    /// Group of the file. `None` stands for the group that the system gives.
    pub group: Option<u32>,
    /// Replaces a file that is not a ring of this crate, although a process may still use it.
    ///
    /// Processes that have the old file mapped keep it, and exchange no message with this
    /// publisher. A living publisher of this crate is never replaced.
    pub force: bool,
}

impl Default for PublisherOptions {
    /// 16 slots of 4096 bytes, raw bytes, readable and writable for user and group.
    fn default() -> Self {
        PublisherOptions {
            geometry: Geometry::default(),
            content: ContentTag::RAW,
            mode: 0o660,
            group: None,
            force: false,
        }
    }
}

/// How a topic is read.
///
/// The default is every message from now on, guarded where the file belongs to another user.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SubscriberOptions {
    /// Which messages to begin with, if the topic exists. A topic that appears later is read from
    /// its first message.
    pub start: Start,
    /// Which messages to get after falling behind.
    pub policy: Policy,
    /// Whether to read without touching memory that another process could take away.
    pub guard: Guard,
}

/// How a topic is watched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObserverOptions {
    /// Which messages to begin with, if the topic exists. A topic that appears later is watched
    /// from its first message.
    pub start: Start,
    /// Which messages to get after falling behind.
    pub policy: Policy,
    /// As [`SubscriberOptions::guard`].
    pub guard: Guard,
    /// The longest time that a new message can go unnoticed while no subscriber waits on the
    /// topic; see [`Observer`](crate::Observer).
    pub longest_nap: Duration,
}

impl Default for ObserverOptions {
    /// Every message from now on, noticed within 4 ms.
    fn default() -> Self {
        ObserverOptions {
            start: Start::default(),
            policy: Policy::default(),
            guard: Guard::default(),
            longest_nap: Duration::from_millis(4),
        }
    }
}

/// Whether a topic is read in guarded mode: without ever touching memory that another process
/// could take away.
///
/// A process that may write a topic's file may also shorten it. A process that then touches the
/// missing part through a mapping is killed by SIGBUS. In guarded mode that is an error
/// ([`Fault::Truncated`](crate::Fault::Truncated)).
///
/// Guarded reading has a price: a few system calls for each message, no message is held in its
/// slot ([`Lease`](crate::Lease)s are copies), and the subscriber does not show among
/// [`Info::readers`](crate::Info::readers).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Guard {
    /// Guarded when the file belongs to a user who is not trusted: see [`trust`](crate::trust).
    #[default]
    Auto,
    /// Always guarded.
    Always,
    /// Never guarded. Every owner of the file is trusted.
    Never,
}
