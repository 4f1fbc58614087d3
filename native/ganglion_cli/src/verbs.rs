//! The verbs of `ganglion`, one file each.
//!
//! A new verb also needs
//!
//! - its module and its line in [`ALL`] below,
//! - its row in the table of `main.rs`,
//! - tests: the list of verbs in `command_line.rs`, and one in `tests/verbs.rs`,
//! - its section in `docs/guides/tools.md`.

mod bw;
mod doctor;
mod echo;
mod hz;
mod info;
mod latency;
mod topics;

use crate::verb::Verb;

/// All verbs, in the order of the help.
pub const ALL: &[&Verb] = &[
    &topics::VERB,
    &info::VERB,
    &echo::VERB,
    &hz::VERB,
    &bw::VERB,
    &latency::VERB,
    &doctor::VERB,
];
