//! Runs one program under a supervisor that reads its output through a pipe, and leaves nothing
//! of the program running when the supervisor ends.
//!
//! ```text
//! process_guard [--grace-ms N] [--halt-ms N] [--nice N] [--lines-per-second N] [--frames N]
//!               [--] PROGRAM [ARGUMENT…]
//! ```
//!
//! The program gets an empty standard input. The guard ends the program (SIGTERM to its process
//! group, SIGKILL after the grace period) when the guard's standard input closes or requests the
//! end, or when the guard receives SIGTERM, SIGINT or SIGHUP. Standard input closes when the
//! supervisor dies, even by SIGKILL, because the kernel closes the pipe. With `--halt-ms`, the
//! guard kills a program that a signal has stopped (SIGSTOP) for longer than that time.
//!
//! The guard adopts descendants that left the program's process group and kills them when the
//! program has ended. A second process, the watch (`watch.rs`), does so when the guard itself is
//! killed.
//!
//! The guard reads the program's standard output and error, splits it into lines (`splitter.rs`),
//! limits their rate (`limiter.rs`) and writes them to its standard output, as lines or as frames
//! (`protocol.rs`). The program's pipe never stays full, whatever the supervisor does, and the
//! supervisor gets no more than it takes.
//!
//! Exit status: the program's own; 128 + the signal that ended it; 127 when it cannot be started;
//! 2 for a usage error.

mod guard;
mod limiter;
mod options;
mod process;
mod protocol;
mod splitter;
mod watch;

use std::ffi::OsString;
use std::io::{self, Write};
use std::process::ExitCode;

use limiter::Item;
use options::{Command, Request};
use protocol::Protocol;

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
        Err(error) => fail(Protocol::Lines, &error, 2),
    }
}

fn run(command: &Command, arguments: &[OsString], watched: bool) -> ExitCode {
    let result = if watched {
        guard::run(command)
    } else {
        watch::run(arguments)
    };
    result.unwrap_or_else(|error| fail(command.protocol, &error.to_string(), 127))
}

fn fail(protocol: Protocol, message: &str, status: u8) -> ExitCode {
    let message = format!("process_guard: {message}");
    if protocol == Protocol::Lines {
        eprintln!("{message}");
    } else {
        let line = protocol.encode(&Item::Line(message.into_bytes()));
        let _ = io::stdout().write_all(&line);
    }
    ExitCode::from(status)
}
