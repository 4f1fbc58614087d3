//! The options of a publisher.

use std::ffi::c_char;

use conduit_ring::{Geometry, PublisherOptions};

use crate::failure::Failure;
use crate::geometry::conduit_ring_geometry;
use crate::info::tag;
use crate::pointer;
use crate::version::{self, CONDUIT_RING_ABI_VERSION};

/// `flags`: replace a foreign file even if a process may still use it.
pub const CONDUIT_RING_FORCE: u32 = 1;

/// `flags`: start no thread that checks the topic's name.
pub const CONDUIT_RING_NO_THREAD: u32 = 2;

/// `group`: the group of the process.
pub const CONDUIT_RING_OWN_GROUP: u32 = 0xFFFF_FFFF;

/// The options of a publisher.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct conduit_ring_publisher_options {
    /// The version of the header.
    pub abi_version: u32,
    /// `CONDUIT_RING_FORCE` and `CONDUIT_RING_NO_THREAD`.
    pub flags: u32,
    /// Number and size of the slots.
    pub geometry: conduit_ring_geometry,
    /// The encoding's name.
    pub content: *const c_char,
    /// Permissions of the file.
    pub mode: u32,
    /// Group of the file.
    pub group: u32,
}

/// Reads the options, and whether to start a thread that checks the topic's name.
///
/// # Safety
/// `options` is null or points to options whose texts are valid.
pub(crate) unsafe fn read(
    options: *const conduit_ring_publisher_options,
) -> Result<(PublisherOptions, bool), Failure> {
    if options.is_null() {
        return Ok((PublisherOptions::default(), true));
    }
    // SAFETY: each version of the options starts with its version.
    let abi_version = *unsafe { pointer::shared(options.cast::<u32>(), "options") }?;
    version::check(abi_version, "options")?;
    // SAFETY: the options have this version.
    let options = unsafe { pointer::shared(options, "options") }?;
    if options.flags & !(CONDUIT_RING_FORCE | CONDUIT_RING_NO_THREAD) != 0 {
        let flags = options.flags;
        return Err(Failure::invalid(format!(
            "invalid flags: expected CONDUIT_RING_FORCE, CONDUIT_RING_NO_THREAD, both or 0, \
             got: {flags:#x}"
        )));
    }
    let own_thread = options.flags & CONDUIT_RING_NO_THREAD == 0;
    let options = PublisherOptions {
        geometry: Geometry::try_from(options.geometry)?,
        // SAFETY: null or a NUL-terminated text, as the caller guarantees.
        content: unsafe { tag(options.content) }?,
        mode: options.mode,
        group: (options.group != CONDUIT_RING_OWN_GROUP).then_some(options.group),
        force: options.flags & CONDUIT_RING_FORCE != 0,
    };
    Ok((options, own_thread))
}

const _: () = assert!(CONDUIT_RING_ABI_VERSION != 0, "zeroed options are an error");
