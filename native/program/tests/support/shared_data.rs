//! Recordings that lie beside the repository and are not part of it.

use std::io::Write;
use std::path::{Path, PathBuf};

/// Returns the folder of photographs with AprilTags and their ground truth. When it is absent, a
/// line on stderr says that the test is skipped; `eprintln!` would not do, as the test harness
/// captures it.
pub fn tags_folder() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folder = root.join("../shared/data/tags");
    if folder.is_dir() {
        return Some(folder);
    }
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    let _ = writeln!(
        std::io::stderr(),
        "SKIPPED {test}: there is no folder {}",
        folder.display()
    );
    None
}
