//! Number and size of slots.

use std::ffi::c_int;

use conduit_ring::Geometry;

use crate::failure::{Failure, status};
use crate::pointer::Out;

/// The size of a slot's header.
pub const CONDUIT_RING_SLOT_HEADER_BYTES: u32 = 20;

const _: () = {
    let shortest = Geometry::MIN_SLOT_SIZE;
    assert!(shortest == CONDUIT_RING_SLOT_HEADER_BYTES + 1);
};

/// Number and size of a ring's slots.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct conduit_ring_geometry {
    /// A power of two.
    pub slot_count: u32,
    /// Includes the slot's header.
    pub slot_size_bytes: u32,
}

impl From<Geometry> for conduit_ring_geometry {
    fn from(geometry: Geometry) -> Self {
        conduit_ring_geometry {
            slot_count: geometry.slot_count(),
            slot_size_bytes: geometry.slot_size(),
        }
    }
}

impl TryFrom<conduit_ring_geometry> for Geometry {
    type Error = conduit_ring::Error;

    fn try_from(geometry: conduit_ring_geometry) -> Result<Geometry, conduit_ring::Error> {
        Geometry::slots(geometry.slot_count, geometry.slot_size_bytes)
    }
}

fn put(
    out: *mut conduit_ring_geometry,
    geometry: Result<Geometry, conduit_ring::Error>,
) -> c_int {
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(out, "geometry") }?;
        let geometry = geometry.map_err(Failure::from)?;
        out.put(conduit_ring_geometry {
            slot_count: geometry.slot_count(),
            slot_size_bytes: geometry.max_message_size() as u32 + CONDUIT_RING_SLOT_HEADER_BYTES,
        });
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_geometry_slots(
    slot_count: u32,
    slot_size_bytes: u32,
    geometry: *mut conduit_ring_geometry,
) -> c_int {
    put(geometry, Geometry::slots(slot_count, slot_size_bytes))
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_geometry_depth(
    depth: u32,
    max_message_size_bytes: u32,
    geometry: *mut conduit_ring_geometry,
) -> c_int {
    put(geometry, Geometry::depth(depth, max_message_size_bytes))
}
