//! Names that differ between runs of the tests on one machine. Shared by the tests of all crates.

use std::sync::atomic::{AtomicU32, Ordering};

/// Returns a name that no other test has, in this run or another, for a topic or a file. It
/// begins with the run's name, which `bin/test` sets and by which it finds leftovers of the run.
pub fn unique(label: &str) -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let n = COUNT.fetch_add(1, Ordering::Relaxed);
    let run = std::env::var("GANGLION_RUN").unwrap_or_else(|_| "run".into());
    format!("{run}.{}.{n}.{label}", std::process::id())
}
