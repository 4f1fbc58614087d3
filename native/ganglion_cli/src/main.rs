//! `ganglion`: shows, measures and repairs the ring topics of this machine.
//!
//! | verb | purpose |
//! |---|---|
//! | `topics` | lists all topics |
//! | `info` | shows the details of a topic |
//! | `echo` | prints messages, decoded if the content tag names a known encoding |
//! | `hz`, `bw`, `latency` | measure a topic's messages |
//! | `doctor` | finds, and with `--fix` repairs, what killed processes left in /dev/shm |
//!
//! Each verb is a file in `verbs`. The verbs that watch a topic are observers: they take no
//! reader slot, cost the publisher nothing, and continue when it dies and starts again.

mod command_line;
mod decode;
mod failure;
mod gauge;
mod missing_topic;
mod names;
mod options;
mod output;
mod process;
mod render;
mod units;
mod verb;
mod verbs;
mod watch;
mod window;

use command_line::Call;
use options::Options;
use output::Output;
use program::stop::Stop;
use program::{Failure, Log};
use std::process::ExitCode;
use verb::Verb;

fn main() -> ExitCode {
    program::run("ganglion", |log| {
        match command_line::parse(std::env::args_os().skip(1))? {
            Call::Help(text) => program::print_help(&text),
            Call::Version => program::print_version("ganglion", env!("CARGO_PKG_VERSION")),
            Call::Run(verb, options) => run(verb, &options, log)?,
        }
        Ok(())
    })
}

fn run(verb: &Verb, options: &Options, log: Log) -> Result<(), Failure> {
    let stop = Stop::of_process(false)
        .map_err(|error| Failure::Runtime(format!("could not handle signals: {error}")))?;
    let mut output = Output::to_stdout(options.json, stop);
    (verb.run)(options, &mut output, log)
}
