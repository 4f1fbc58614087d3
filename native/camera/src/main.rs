//! The camera's `main`; the library does the work.

use camera::options::{Call, HELP, Options};
use program::stop::Stop;
use program::{Failure, Log};
use std::process::ExitCode;

fn main() -> ExitCode {
    program::run("camera", |log| {
        match Call::parse(std::env::args_os().skip(1))? {
            Call::Help => program::print_help(HELP),
            Call::Version => program::print_version("camera", env!("CARGO_PKG_VERSION")),
            Call::Check(picture) => camera::check(&picture)?,
            Call::Run(options) => run(&options, log)?,
        }
        Ok(())
    })
}

fn run(options: &Options, log: Log) -> Result<(), Failure> {
    let stop = Stop::of_process(options.exit_with_stdin)
        .map_err(|error| Failure::Runtime(format!("could not handle signals: {error}")))?;
    camera::run(options, &stop, log)
}
