//! `ganglion`: shows, measures and repairs the ring topics of this machine.
//!
//! | verb | what it does |
//! |---|---|
//! | `topics` | lists all topics |
//! | `info` | all that is known of one topic |
//! | `echo` | prints messages, decoded where the content tag names an encoding that is known here |
//! | `hz`, `bw`, `latency` | measure while they watch |
//! | `doctor` | finds, and with `--fix` repairs, what kills have left in /dev/shm |
//!
//! Each verb is a file in `verbs`. Those that watch are observers: they take no reader slot, cost the publisher nothing, and
//! go on when it dies and comes back.

mod absent;
mod content;
mod decode;
mod gauge;
mod options;
mod output;
mod process;
mod render;
mod state;
mod units;
mod verbs;
mod watch;
mod window;

use options::{Call, Options};
use output::Output;
use program::stop::Stop;
use program::{Failure, Log};
use std::process::ExitCode;
use verbs::Verb;

fn main() -> ExitCode {
    program::run("ganglion", |log| {
        match options::read(std::env::args_os().skip(1))? {
            Call::Help(text) => program::print_help(&text),
            Call::Version => program::print_version("ganglion", env!("CARGO_PKG_VERSION")),
            Call::Run(verb, options) => run(verb, &options, log)?,
        }
        Ok(())
    })
}

fn run(verb: &Verb, options: &Options, log: Log) -> Result<(), Failure> {
    let stop = Stop::of_process(false)
        .map_err(|error| Failure::Runtime(format!("signals cannot be received: {error}")))?;
    let mut output = Output::to_stdout(options.json, stop);
    (verb.run)(options, &mut output, log)
}

/// The world's trouble, in the words of whoever met it.
fn world(error: impl std::error::Error) -> Failure {
    Failure::Runtime(error.to_string())
}
