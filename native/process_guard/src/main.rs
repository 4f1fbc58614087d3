//! Runs one program for a supervisor that reads its output through a pipe, and lets nothing of it
//! outlive that supervisor.
//!
//! ```text
//! process_guard [--grace-ms N] [--halt-ms N] [--nice N] [--lines-per-second N] [--frames N]
//!               [--] PROGRAM [ARGUMENT…]
//! ```
//!
//! The program gets an empty standard input. The guard ends it (SIGTERM to its process group,
//! SIGKILL after the grace) as soon as the guard's standard input reaches its end or asks for it,
//! or the guard receives SIGTERM, SIGINT or SIGHUP. The end of standard input is how the death of
//! the supervisor shows, also by SIGKILL: the kernel closes the pipe. A program that a signal has
//! halted (SIGSTOP) is killed when it has not gone on in time.
//!
//! Descendants that left the program's process group are adopted by the guard and killed when the
//! program has ended. The guard itself has a watch (`watch.rs`), which does that when the guard
//! is killed.
//!
//! What the program prints, on standard output and error, is read by the guard, cut into lines
//! (`lines.rs`), held to a rate (`limiter.rs`) and given on by standard output, as lines or as
//! frames (`output.rs`). Its pipe is never full for long, whatever the supervisor does, and the
//! supervisor gets no more than it takes.
//!
//! Exit status: the program's own; 128 + the signal that ended it; 127 when it cannot be started;
//! 2 for wrong options.

mod guard;
mod limiter;
mod lines;
mod options;
mod output;
mod process;
mod watch;

use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;

use limiter::Item;
use options::{Command, Request};
use output::Speech;

fn main() -> ExitCode {
    let mut arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    let watched = arguments
        .first()
        .is_some_and(|first| first == watch::WATCHED);
    if watched {
        arguments.remove(0);
    }
    match options::parse(arguments.iter().cloned()) {
        Ok(Request::Help) => {
            print!("{}", options::HELP);
            ExitCode::SUCCESS
        }
        Ok(Request::Version) => {
            println!("process_guard {}", env!("CARGO_PKG_VERSION"));
            ExitCode::SUCCESS
        }
        Ok(Request::Run(command)) => run(&command, &arguments, watched),
        Err(error) => fail(Speech::Plain, &error, 2),
    }
}

fn run(command: &Command, arguments: &[OsString], watched: bool) -> ExitCode {
    let result = if watched {
        guard::run(command)
    } else {
        watch::run(arguments)
    };
    result.unwrap_or_else(|error| fail(command.speech, &error.to_string(), 127))
}

fn fail(speech: Speech, message: &str, status: u8) -> ExitCode {
    let message = format!("process_guard: {message}");
    if speech == Speech::Plain {
        eprintln!("{message}");
    } else {
        let line = speech.item(&Item::Line(message.into_bytes()));
        let _ = io::stdout().write_all(&line);
    }
    ExitCode::from(status)
}
