//! Message rings in shared memory: one writer, many readers, any process.
#![cfg_attr(loom, allow(dead_code))]

#[cfg(not(target_has_atomic = "64"))]
compile_error!("the ring needs lock-free 64-bit atomics");
#[cfg(not(target_endian = "little"))]
compile_error!("the ring's bytes are little-endian");
#[cfg(not(target_os = "linux"))]
compile_error!("the ring needs Linux: futexes and open-file-description locks");

mod claim;
mod geometry;
mod layout;
#[cfg_attr(loom, path = "memory_model.rs")]
mod memory;
mod reader;
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
pub mod clock;
#[cfg(not(loom))]
mod copy;
#[cfg(not(loom))]
mod create;
#[cfg(not(loom))]
mod header;
#[cfg(not(loom))]
mod info;
#[cfg(not(loom))]
mod publisher;
#[cfg(not(loom))]
mod segment;
#[cfg(not(loom))]
mod subscriber;
#[cfg(not(loom))]
mod waker;

pub use content::ContentTag;
pub use error::{Error, Fault, PublishError};
pub use geometry::Geometry;
pub use reader::{Meta, Policy, Start};
pub use topic::Topic;

#[cfg(not(loom))]
pub use {
    info::{Info, Reader, State},
    publisher::{Publisher, PublisherOptions},
    subscriber::{Read, Received, Stats, Subscriber, SubscriberOptions, Wait},
    waker::Waker,
};
