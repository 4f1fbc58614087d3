//! The verbs of `ganglion`, one file each.

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
