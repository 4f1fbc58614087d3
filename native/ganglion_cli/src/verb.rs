//! The description of a verb, which each file in `verbs` fills in.

use crate::options::Options;
use crate::output::Output;
use program::{Failure, Log};

/// A verb of `ganglion`.
pub struct Verb {
    /// The name as it is typed.
    pub name: &'static str,
    /// A few words for the list of verbs.
    pub summary: &'static str,
    /// The text that `--help` prints.
    pub help: &'static str,
    /// Whether the verb takes a topic.
    pub takes_topic: bool,
    /// The options that the verb accepts.
    pub options: &'static [&'static str],
    /// Runs the verb.
    pub run: fn(&Options, &mut Output, Log) -> Result<(), Failure>,
}
