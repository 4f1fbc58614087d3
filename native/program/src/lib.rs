//! Shared foundation of Ganglion's native programs: options, log lines, failures and a clean
//! stop.
//!
//! Each program uses it the same way, so that all of them behave alike on the command line and
//! under a supervisor.
//!
//! | part | purpose |
//! |---|---|
//! | [`arguments`] | reads `--long-name VALUE`; an error names the option, the expected and the given value |
//! | [`Failure`], [`run`] | one line on stderr and an exit status: 2 for a usage error, 1 for a failure at run time |
//! | [`Log`] | plain lines on stderr that start with the program's name |
//! | [`nearest`] | finds the known name that is closest to a mistyped one |
//! | [`stop`] | ends the program cleanly on SIGTERM, SIGINT and, on request, the end of stdin |
//!
//! ```
//! use program::{Failure, Log};
//! use std::process::ExitCode;
//!
//! fn work(log: Log) -> Result<(), Failure> {
//!     log.line("nothing to do");
//!     Ok(())
//! }
//!
//! assert_eq!(program::run("example", work), ExitCode::SUCCESS);
//! ```

pub mod arguments;
pub mod nearest;
pub mod stop;

use std::fmt;
use std::io::{self, Write};
use std::process::ExitCode;

/// The reason why a program ends without having done its work: one line of text, without the
/// program's name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// A wrong command line. The text says what was expected and what was given. Exit status 2.
    Usage(String),
    /// A failure at run time, such as a file that cannot be read. Exit status 1.
    Runtime(String),
}

impl Failure {
    /// The former name of [`Failure::Runtime`].
    #[allow(non_snake_case)]
    #[deprecated(note = "use Failure::Runtime")]
    pub fn World(text: String) -> Failure {
        Failure::Runtime(text)
    }

    fn exit_status(&self) -> u8 {
        match self {
            Failure::Usage(_) => 2,
            Failure::Runtime(_) => 1,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Usage(text) | Failure::Runtime(text) => f.write_str(text),
        }
    }
}

/// The log of a program: plain lines on stderr.
#[derive(Debug, Clone, Copy)]
pub struct Log {
    program: &'static str,
}

impl Log {
    /// Returns the log of `program`.
    pub fn of(program: &'static str) -> Log {
        Log { program }
    }

    /// Writes one line. Errors are ignored: a closed stderr does not stop the program.
    pub fn line(&self, text: impl fmt::Display) {
        let _ = writeln!(io::stderr().lock(), "{}: {text}", self.program);
    }
}

/// Runs a program's body. A failure is written to the log and sets the exit status.
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
