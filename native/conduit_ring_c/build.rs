//! Gives the shared library the name that programs linked with it look for.

/// `CONDUIT_RING_ABI_VERSION`, whose agreement with this line a test holds.
const SONAME: &str = "libconduit_ring.so.2";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,{SONAME}");
}
