//! The detector's `main`; the library does the work.

use program::stop::Stop;
use program::{Failure, Log};
use std::process::ExitCode;
use vision_tags::options::{Call, HELP, Options};

fn main() -> ExitCode {
    program::run("vision_tags", |log| {
        match Call::parse(std::env::args_os().skip(1))? {
            Call::Help => program::print_help(HELP),
            Call::Version => program::print_version("vision_tags", env!("CARGO_PKG_VERSION")),
            Call::Run(options) => run(&options, log)?,
        }
        Ok(())
    })
}

fn run(options: &Options, log: Log) -> Result<(), Failure> {
    let stop = Stop::of_process(options.exit_with_stdin)
        .map_err(|error| Failure::Runtime(format!("could not handle signals: {error}")))?;
    vision_tags::run(options, &stop, log)
}
