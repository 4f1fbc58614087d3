//! The manners that Ganglion's native programs share: how they take options, log, fail and stop.
//!
//! | part | what it promises |
//! |---|---|
//! | [`arguments`] | `--long-name VALUE`; a wrong one is named together with what is accepted |
//! | [`Failure`], [`run`] | one line on stderr and the exit status: 2 for a wrong call, 1 for the world's trouble |
//! | [`Log`] | plain lines on stderr that start with the program's name |
//! | [`nearest`] | what was meant by a name that nobody has |
//! | [`stop`] | SIGTERM, SIGINT and, when asked for, the end of stdin end the program cleanly |

pub mod arguments;
pub mod nearest;
pub mod stop;

use std::fmt;
use std::io::{self, Write};
use std::process::ExitCode;

/// Why a program ends without having done its work. The text is one line, without the program's name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// It was called wrongly: says what was given and what is accepted. Exit status 2.
    Usage(String),
    /// The world is not as it should be, such as a file that cannot be read. Exit status 1.
    World(String),
}

impl Failure {
    fn exit_status(&self) -> u8 {
        match self {
            Failure::Usage(_) => 2,
            Failure::World(_) => 1,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Usage(text) | Failure::World(text) => f.write_str(text),
        }
    }
}

/// A program's log: plain lines on stderr.
#[derive(Debug, Clone, Copy)]
pub struct Log {
    program: &'static str,
}

impl Log {
    /// The log of `program`.
    pub fn of(program: &'static str) -> Log {
        Log { program }
    }

    /// Writes one line. A reader that has gone away is no reason to stop.
    pub fn line(&self, text: impl fmt::Display) {
        let _ = writeln!(io::stderr().lock(), "{}: {text}", self.program);
    }
}

/// Runs a program's body; a failure becomes its line and its exit status.
pub fn run(program: &'static str, body: impl FnOnce(Log) -> Result<(), Failure>) -> ExitCode {
    let log = Log::of(program);
    match body(log) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            log.line(&failure);
            ExitCode::from(failure.exit_status())
        }
    }
}

/// Prints the answer to `--version`.
pub fn print_version(program: &str, version: &str) {
    print_help(&format!("{program} {version}\n"));
}

/// Prints the answer to `--help`.
pub fn print_help(text: &str) {
    let _ = io::stdout().lock().write_all(text.as_bytes());
}
