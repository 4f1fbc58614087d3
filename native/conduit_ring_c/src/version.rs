//! The versions of header and library.

use std::ffi::c_char;

use crate::failure::Failure;

/// The version of the ABI: changes with each change of the header that affects compiled programs.
pub const CONDUIT_RING_ABI_VERSION: u32 = 2;

/// Checks the version of the header that options were compiled with, before anything else of them
/// is read.
pub(crate) fn check(abi_version: u32, name: &str) -> Result<(), Failure> {
    if abi_version == CONDUIT_RING_ABI_VERSION {
        return Ok(());
    }
    Err(Failure::invalid(format!(
        "expected {name} with abi_version {CONDUIT_RING_ABI_VERSION}, got: {abi_version}; \
         start with the header's _INIT macro"
    )))
}

#[unsafe(no_mangle)]
extern "C" fn conduit_ring_abi_version() -> u32 {
    CONDUIT_RING_ABI_VERSION
}

#[unsafe(no_mangle)]
extern "C" fn conduit_ring_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}
