//! Message rings in shared memory: one publisher and up to 16 subscribers of a topic, in any processes of one machine.
//!
//! A topic is a file, `/dev/shm/conduit_{topic}`, that everyone maps. The publisher copies a message into the next slot
//! of the ring and goes on; it never waits for anyone, and makes a system call only when a subscriber sleeps. Each
//! subscriber copies messages out at its own pace. One that falls behind by more than the ring loses the oldest messages,
//! and each message says how many were lost before it.
//!
//! ```
//! use std::time::Duration;
//! use conduit_ring::{Publisher, PublisherOptions, Read, Subscriber, SubscriberOptions, Topic};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let name = format!("doc-{}", std::process::id());
//! # let name = name.as_str();
//! let topic = Topic::new(name)?; // for example "imu"
//!
//! // In one process:
//! let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
//!
//! // In another one, before or after:
//! let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default())?;
//!
//! let sequence = publisher.publish(b"12.5 degrees")?;
//!
//! let mut buffer = Vec::new();
//! match subscriber.read_timeout(&mut buffer, Duration::from_secs(1))? {
//!     Read::Message(meta) => {
//!         assert_eq!((meta.sequence, meta.lost), (sequence, 0));
//!         assert_eq!(buffer, b"12.5 degrees");
//!     }
//!     Read::PublisherUp | Read::PublisherDown => {} // it came, or it went
//!     Read::Nothing => {}                           // the second is over
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # What is guaranteed
//!
//! - **A message is delivered whole or not at all.** It is validated after it was copied; what the publisher may have
//!   begun to overwrite is dropped and counted as lost.
//! - **A crash needs no repair.** Whoever is killed, at whatever instant, leaves nothing that a successor cannot go on
//!   with: a new publisher takes over in place at the same sequence number, without its subscribers noticing; slots of
//!   dead subscribers are taken back. Who lives is told by file locks that the kernel frees, never by a timer or a pid.
//! - **No wake-up is lost.** A subscriber that sleeps is woken by the next message.
//! - **Silence is told from absence.** A subscriber learns that the publisher died, closed or came back
//!   ([`Read::PublisherDown`], [`Read::PublisherUp`]), at most half a second later, and after its last message. It
//!   attaches to the topic's next life by itself.
//! - **Nothing in the file is believed.** Geometry is checked against the file's real size before anything is mapped,
//!   lengths against the geometry. A damaged file is an error or no data.
//! - **A topic keeps its name.** A publisher whose file was removed, or whose name was given to another file, makes the file
//!   anew under the same sequence numbers, or says why it cannot ([`Publisher::look_after`]).
//! - **A reader stops nobody else**, whatever it holds and however it hangs ([`Lease`]).
//! - **Memory is bounded** by the geometry, and allocated when the topic is made: a full `/dev/shm` is an error then.
//!
//! Sequence numbers count from 0 within one segment. A publisher that dies is succeeded in the same segment; one that
//! closes its topic, or a successor with another [`Geometry`] or [`ContentTag`], ends it, and the next begins at 0.
//!
//! Unmodified conduit programs (C++) can be at either end; "legacy" in this documentation means such a peer. Of a legacy
//! publisher one slot fewer is trusted, and its death is noticed a second or two later, when nobody but subscribers of this
//! crate has its file mapped.
//!
//! # When not to use it
//!
//! - When every message must arrive: a slow subscriber loses messages and the publisher does not slow down.
//! - Between machines.
//! - To publish between users who do not trust each other: whoever may write the file may shorten it, and that is a SIGBUS
//!   for all who have it mapped. A file of a user who is not trusted ([`trust`]) is therefore never mapped: publishers refuse
//!   it ([`Error::ForeignOwner`]), and subscribers read it slowly ([`Guard`]).
//! - For several publishers of one topic: the second is refused. Use a topic for each.
//! - Across `fork` without `exec`: what the parent opened is refused in the child ([`Error::Forked`]), which neither closes
//!   nor unlinks nor unlocks any of it. But the child shares its parent's locks, and would keep a dead parent's topic locked.
//!
//! # How it is built
//!
//! The protocol is in `writer`, `reader`, `wait` and `claim`, written against words at offsets (`layout`, `memory`);
//! `os` alone calls the operating system. The protocol runs under [loom](https://docs.rs/loom) as it is, see
//! `loom_tests`.
#![cfg_attr(loom, allow(dead_code))]

#[cfg(not(target_has_atomic = "64"))]
compile_error!("the ring needs lock-free 64-bit atomics");
#[cfg(not(target_endian = "little"))]
compile_error!("the ring's bytes are little-endian");
#[cfg(not(target_os = "linux"))]
compile_error!("the ring needs Linux: futexes and open-file-description locks");

mod claim;
mod delivery;
mod geometry;
mod layout;
#[cfg_attr(loom, path = "memory_model.rs")]
mod memory;
mod pins;
mod reader;
mod sink;
mod source;
mod sync;
mod wait;
mod writer;

#[cfg(all(test, loom))]
mod loom_tests;

mod content;
mod crc32;
mod error;
mod topic;

#[cfg(not(loom))]
mod attach;
#[cfg(not(loom))]
mod attachment;
#[cfg(not(loom))]
mod backing;
#[cfg(not(loom))]
pub mod clock;
#[cfg(not(loom))]
mod copy;
#[cfg(not(loom))]
mod create;
#[cfg(not(loom))]
mod guarded;
#[cfg(not(loom))]
mod header;
#[cfg(not(loom))]
mod info;
#[cfg(not(loom))]
mod lease;
#[cfg(not(loom))]
mod legacy;
#[cfg(not(loom))]
mod listing;
#[cfg(not(loom))]
mod loan;
#[cfg(not(loom))]
mod observer;
#[cfg(not(loom))]
mod options;
#[cfg(not(loom))]
mod os;
#[cfg(not(loom))]
mod outcome;
#[cfg(not(loom))]
mod owner;
#[cfg(not(loom))]
mod processes;
#[cfg(not(loom))]
mod publication;
mod publish_error;
#[cfg(not(loom))]
mod publisher;
#[cfg(not(loom))]
mod registration;
#[cfg(not(loom))]
mod renew;
#[cfg(not(loom))]
pub mod repair;
#[cfg(not(loom))]
mod subscriber;
#[cfg(not(loom))]
mod subscription;
#[cfg(not(loom))]
mod takeover;
#[cfg(not(loom))]
pub mod trust;
#[cfg(not(loom))]
pub mod upkeep;
#[cfg(not(loom))]
mod waker;

pub use content::ContentTag;
pub use delivery::{Meta, Policy, Start};
pub use error::{Error, Fault};
pub use geometry::Geometry;
pub use publish_error::PublishError;
pub use topic::Topic;

#[cfg(not(loom))]
pub use {
    attachment::Incarnation,
    guarded::Guard,
    info::{Info, Reader, State},
    lease::Lease,
    listing::Listing,
    loan::{Loan, SuspendedLoan},
    observer::Observer,
    options::{ObserverOptions, PublisherOptions, SubscriberOptions},
    outcome::{Read, Received, Stats, Wait},
    owner::Owner,
    processes::{Nameless, nameless_publishers},
    publisher::Publisher,
    subscriber::Subscriber,
    waker::Waker,
};
