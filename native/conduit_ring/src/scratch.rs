//! Topics of unit tests.

#[path = "../tests/support/run.rs"]
mod run;

use std::ops::Deref;

use crate::topic::Topic;

/// A topic with a unique name, whose file is removed afterwards.
pub(crate) struct Scratch(Topic);

impl Scratch {
    pub(crate) fn new() -> Scratch {
        Scratch(Topic::new(&run::unique("unit")).unwrap())
    }
}

impl Deref for Scratch {
    type Target = Topic;

    fn deref(&self) -> &Topic {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(self.0.path());
    }
}
