//! Message rings in shared memory: one publisher and up to 16 subscribers of a topic, in any
//! processes of one machine.
//!
//! Use it to hand samples, frames and commands from one process to others within microseconds,
//! when the newest data matter more than every message, and when any of the processes may crash.
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
//!     Read::PublisherUp | Read::PublisherDown => {} // the publisher came back, or ended
//!     Read::Nothing => {}                           // the second has passed
//! }
//! # Ok(())
//! # }
//! ```
//!
//! | to | use |
//! |---|---|
//! | publish messages | [`Publisher`], with [`PublisherOptions`] and a [`Geometry`] |
//! | write a message in place, without a copy | [`Publisher::loan`] → [`Loan`] |
//! | read messages | [`Subscriber`], with [`SubscriberOptions`] |
//! | look at a message in place, without a copy | [`Subscriber::try_lease`] → [`Lease`] |
//! | watch a topic without a trace, as tools and recorders do | [`Observer`] |
//! | wake a subscriber from another thread | [`Waker`] |
//! | list the topics, inspect one | [`Listing`], [`Info`] |
//! | share topics between users | [`trust`], [`Guard`] |
//! | keep the name of a publisher that may be silent | [`Publisher::look_after`], [`upkeep`] |
//! | clean up after crashes, by a person's tool | [`repair`] |
//!
//! # The segment
//!
//! A topic is a file, `/dev/shm/conduit_{topic}`, that publisher and subscribers map. It is
//! called a *segment*: a header of 1216 bytes, then the slots.
//!
//! ```text
//!     0 ┌──────────────────────────────────────────────────────────────┐
//!       │ geometry, version, instance_id, content tag; state, epoch    │ what the segment is
//!    64 ├──────────────────────────────────────────────────────────────┤
//!       │ write_idx    messages published  ◄── lock: a publisher lives │ the publisher's
//!       │ write_intent the message being written, + 1; counters        │ cache line
//!   128 ├──────────────────────────────────────────────────────────────┤
//!       │ subscriber_mask, futex_word, native_, waiting_, pin_mask     │ shared by both sides
//!   192 ├──────────────────────────────────────────────────────────────┤
//!       │ reader slot 0: read_idx          ◄── lock: this reader lives │ one cache line
//!       │                pid, lost_count, claim_id, 3 pins             │ for each reader
//!   256 ├──────────────────────────────────────────────────────────────┤
//!       │ reader slots 1 to 15                                         │
//!  1216 ├──────────────────────────────────────────────────────────────┤
//!       │ slot 0: length │ sequence │ time │ payload …                 │ with 16 slots:
//!       ├──────────────────────────────────────────────────────────────┤ message 0, 16, 32, …
//!       │ slot 1                                                       │ message 1, 17, 33, …
//!       │ …                                                            │
//!       └──────────────────────────────────────────────────────────────┘
//! ```
//!
//! Message n lies in slot n & (`slot_count` − 1), until message n + `slot_count` overwrites it.
//! The [`Geometry`] of a topic says how many slots it has and how long they are. The repository's
//! `docs/wire-format.md` lists every byte.
//!
//! The publisher copies a message into the next slot and returns. It never waits for a reader,
//! and makes a system call only when a reader sleeps. Each subscriber copies messages out at its
//! own pace. A subscriber that falls behind by more than the ring loses the oldest messages, and
//! each message says how many were lost before it ([`Meta::lost`]).
//!
//! # What is guaranteed
//!
//! - **A message is delivered whole or not at all.** A subscriber copies a message and validates
//!   it afterwards. A copy that the publisher may have begun to overwrite is dropped and counted
//!   as lost.
//! - **A crash needs no repair.** A process that is killed, at whatever instant, leaves a segment
//!   that its successor can use. A new publisher takes over in place at the same sequence number,
//!   without its subscribers noticing. Reader slots of dead subscribers are taken back. File
//!   locks show which processes live, and the kernel frees them; no timer and no process number
//!   decides.
//! - **No wake-up is lost.** A subscriber that sleeps is woken by the next message.
//! - **Silence differs from absence.** A subscriber reports that the publisher died, closed the
//!   topic or came back ([`Read::PublisherDown`], [`Read::PublisherUp`]), at most half a second
//!   later, and after the last message. It attaches to the topic's next segment by itself.
//! - **No byte of the file is trusted.** The geometry is checked against the file's real size
//!   before the file is mapped, and lengths against the geometry. A damaged file gives an error
//!   or no data.
//! - **A topic keeps its name.** A publisher whose file was removed, or whose name leads to
//!   another file, makes the file anew under the same sequence numbers, or says why it cannot
//!   ([`Publisher::look_after`]).
//! - **A reader stops no other process**, whatever it holds and however it hangs ([`Lease`]).
//! - **Memory is bounded** by the geometry, and allocated when the topic is made. A full
//!   `/dev/shm` is an error at that time.
//!
//! Sequence numbers count from 0 within one segment. The successor of a publisher that died
//! continues them. A publisher that closes its topic ends the segment, and so does a successor
//! with another [`Geometry`] or [`ContentTag`]; the next segment begins at 0.
//!
//! Unmodified conduit programs (C++) can be at either end. "Legacy" in this documentation means
//! such a peer. With a legacy publisher one slot fewer is usable, and its death is noticed a
//! second or two later, when no process but subscribers of this crate has its file mapped.
//!
//! # When not to use it
//!
//! - When every message must arrive: a slow subscriber loses messages and the publisher does not
//!   slow down.
//! - Between machines.
//! - To publish between users who do not trust each other. A user who may write the file may also
//!   shorten it, and then every process that has it mapped gets SIGBUS. So the file of a user who
//!   is not [trusted](trust) is never mapped: publishers refuse it ([`Error::ForeignOwner`]), and
//!   subscribers read it slowly ([`Guard`]).
//! - For several publishers of one topic: the second is refused. Use a topic for each.
//! - Across `fork` without `exec`. What the parent opened is refused in the child
//!   ([`Error::Forked`]), which neither closes nor unlinks nor unlocks any of it. But the child
//!   shares its parent's locks, and would keep a dead parent's topic locked.
//!
//! # The life of a subscriber
//!
//! A [`Subscriber`] follows its topic by itself. The arrows name the values that it returns.
//!
//! ```text
//!                        Subscriber::open
//!          a segment in      │       no segment, or one
//!          the state live    │       that is closed or retired
//!             ┌──────────────┴───────────────────┐
//!             ▼                                  ▼
//!     ┌──────────────┐      PublisherUp    ┌──────────┐
//!     │   attached,  │ ◄────────────────── │ awaiting │  sleeps until a file
//!     │ publisher up │                     │ a segment│  of the name appears
//!     └──────────────┘ ──────────────────► └──────────┘
//!         │      ▲       PublisherDown          ▲
//!    lock │      │       closed, retired,       │ name removed,
//!    free │      │       or replaced            │ or replaced
//!         ▼      │ lock taken                   │
//!     ┌───────────────┐                         │
//!     │   attached,   │ ────────────────────────┘
//!     │ publisher down│
//!     └───────────────┘
//! ```
//!
//! An attached subscriber is "up" while the publisher's lock is taken. From "up" to "down" it
//! returns [`Read::PublisherDown`], and back [`Read::PublisherUp`]. A change to "down" or
//! "awaiting" comes after the last message. Where the next segment continues the same messages
//! (the same [`instance_id`](Incarnation::instance_id)), the subscriber continues at its place. A
//! new segment is read from its first message.
//!
//! # The life of an attachment
//!
//! The attachment to one segment is opened in steps, each of which can end it:
//!
//! ```text
//!  open file ──► check owner ──► check header ──► map ──► check state ──► claim reader slot
//!     │              │               │             │           │                │
//!  no file:       stranger:       zeros: await   ENOMEM:    not live:        all 16 taken:
//!  await          read by         damaged:       Os         await            NoReaderSlot
//!                 pread only      BadSegment
//! ```
//!
//! A claimed reader slot is held by a lock on its byte. Bits in the header tell the publisher
//! about it:
//!
//! ```text
//!                  lock; subscriber_mask; native_mask
//!        ┌──────────────────────────────────────────────────┐
//!        │                                                  ▼
//!   ┌─────────┐   native, waiting and pin bits;       ┌──────────┐ ◄─► asleep: waiting_mask
//!   │  free   │ ◄─ subscriber_mask; unlock ────────── │ claimed  │
//!   └─────────┘                                       └──────────┘ ◄─► holding: pin_mask, pins
//!        ▲                                                  │
//!        │   the next subscriber, or the publisher,         │ the process dies, and
//!        │   takes the lock and clears the bits             │ the kernel frees the lock
//!        │                                                  ▼
//!        │                                            ┌──────────┐
//!        └─────────────────────────────────────────── │  leaked  │
//!                                                     └──────────┘
//! ```
//!
//! # A takeover
//!
//! [`Publisher::open`] decides by the lock on byte 64 of the file that has the topic's name:
//!
//! ```text
//!   no file ────────────────────────────────────────────► make a segment, number 0, epoch 0
//!
//!   file ── owner not trusted, without `force` ─────────► Error::ForeignOwner
//!
//!   file ── lock refused ───────────────────────────────► Error::PublisherAlive
//!     │
//!     lock taken
//!     ├── state live, same geometry and content ────────► continue in place: same number,
//!     │                                                   epoch + 1, sleepers are woken
//!     ├── else a ring of this crate ────────────────────► retire it: state retired, sleepers
//!     │                                                   are woken, unlink; make a segment
//!     ├── a legacy ring in use, or another file in use ─► Error::LegacyInUse, BadSegment
//!     └── the same, not in use, or with `force` ────────► unlink; make a segment
//! ```
//!
//! A predecessor that was killed in the middle of message W leaves `write_intent` = W + 1 and
//! `write_idx` = W. The successor writes message W again. Readers reject whatever they copied
//! from the slot between the two, because the intent announces it before and after their copy.
//!
//! # How it is built
//!
//! The protocol is in `writer`, `reader`, `wait`, `pins` and `claim`, written against words at
//! offsets (`layout`, `memory`). `os` alone calls the operating system. The protocol runs under
//! [loom](https://docs.rs/loom) as it is, see `loom_tests`. Each memory ordering has its reason
//! beside it in the source, and the name of the operation on the other side that it pairs with.
#![cfg_attr(loom, allow(dead_code))]

#[cfg(not(target_has_atomic = "64"))]
compile_error!("conduit_ring needs lock-free 64-bit atomics");
#[cfg(not(target_endian = "little"))]
compile_error!("conduit_ring needs a little-endian machine, as its files are");
#[cfg(not(target_os = "linux"))]
compile_error!("conduit_ring needs Linux: futexes and open-file-description locks");

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
mod publish_error;
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
mod life;
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
#[cfg(not(loom))]
mod publisher;
#[cfg(not(loom))]
mod registration;
#[cfg(not(loom))]
mod renew;
#[cfg(not(loom))]
pub mod repair;
#[cfg(all(test, not(loom)))]
mod scratch;
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
    info::{Info, Reader, State},
    lease::Lease,
    listing::Listing,
    loan::{Loan, SuspendedLoan},
    observer::Observer,
    options::{Guard, ObserverOptions, PublisherOptions, SubscriberOptions},
    outcome::{Incarnation, Read, Received, Stats, Wait},
    owner::Owner,
    processes::{Nameless, nameless_publishers},
    publisher::Publisher,
    subscriber::Subscriber,
    waker::Waker,
};
