//! Which header and which library this is.

use std::ffi::c_char;

use crate::failure::Failure;

/// Changes with every change of the header that a compiled program would notice.
pub const CONDUIT_RING_ABI_VERSION: u32 = 2;

/// What options say about the header that they were made with is looked at before anything else of them.
pub(crate) fn check(abi_version: u32, name: &str) -> Result<(), Failure> {
    if abi_version == CONDUIT_RING_ABI_VERSION {
        return Ok(());
    }
    Err(Failure::invalid(format!(
        "{name} has abi_version {abi_version} and this library has {CONDUIT_RING_ABI_VERSION}; begin with the header's _INIT"
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
