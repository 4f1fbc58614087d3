//! Sets the soname, by which the loader finds the shared library.

/// Contains `CONDUIT_RING_ABI_VERSION`; a test compares them.
const SONAME: &str = "libconduit_ring.so.2";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,{SONAME}");
}
