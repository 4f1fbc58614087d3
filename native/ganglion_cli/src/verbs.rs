//! What `ganglion` can do.

mod bw;
mod doctor;
mod echo;
mod hz;
mod info;
mod latency;
mod topics;

use crate::options::Options;
use crate::output::Output;
use program::{Failure, Log};

/// One of the things that `ganglion` can do.
pub struct Verb {
    /// As it is typed.
    pub name: &'static str,
    /// In a few words.
    pub summary: &'static str,
    /// The answer to `--help`.
    pub help: &'static str,
    /// Whether it is about one topic.
    pub takes_topic: bool,
    /// The options that it takes.
    pub options: &'static [&'static str],
    /// Does it.
    pub run: fn(&Options, &mut Output, Log) -> Result<(), Failure>,
}

/// All of them.
pub const ALL: &[&Verb] = &[
    &topics::VERB,
    &info::VERB,
    &echo::VERB,
    &hz::VERB,
    &bw::VERB,
    &latency::VERB,
    &doctor::VERB,
];

/// Their names.
pub fn names() -> Vec<&'static str> {
    ALL.iter().map(|verb| verb.name).collect()
}

/// The answer to `ganglion --help`.
pub fn help() -> String {
    let lines = ALL.iter().map(|verb| {
        let call = format!(
            "{}{}",
            verb.name,
            if verb.takes_topic { " TOPIC" } else { "" }
        );
        format!("  {call:<14} {}\n", verb.summary)
    });
    format!(
        "ganglion: shows, measures and repairs the ring topics of this machine\n\n\
         Usage: ganglion VERB [options]\n\n{}\n  \
         -h, --help     this text; ganglion help VERB and ganglion VERB --help tell more\n  \
         -V, --version  the version\n\n\
         With --json each verb prints one JSON object a line.\n\
         Exit status: 0, 1 when the world is in trouble, 2 for a wrong call.\n",
        lines.collect::<String>()
    )
}
