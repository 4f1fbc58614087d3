//! Names that tell one run of the tests from another on the same machine. Shared by the tests of all crates.

use std::sync::atomic::{AtomicU32, Ordering};

/// A name that no other test has, in this run or another: good for a topic or a file. `bin/test` finds by the run's name,
/// which it sets, what a run has left behind.
pub fn unique(label: &str) -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let n = COUNT.fetch_add(1, Ordering::Relaxed);
    let run = std::env::var("GANGLION_RUN").unwrap_or_else(|_| "run".into());
    format!("{run}.{}.{n}.{label}", std::process::id())
}
