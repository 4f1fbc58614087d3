//! Runs one program for a supervisor that reads its output through a pipe, and lets nothing of it outlive that supervisor.
//!
//! ```text
//! process_guard [--grace-ms N] [--nice N] [--] PROGRAM [ARGUMENT…]
//! ```
//!
//! The program gets an empty standard input and the guard's own standard output and error. The guard ends it (SIGTERM to
//! its process group, SIGKILL after the grace) as soon as the guard's standard input reaches its end or gives a byte, or
//! the guard receives SIGTERM, SIGINT or SIGHUP. The end of standard input is how the death of the supervisor shows,
//! also by SIGKILL: the kernel closes the pipe. If the guard itself is killed, the kernel kills the program.
//!
//! Descendants that left the program's process group are adopted by the guard and killed when the program has ended.
//!
//! Exit status: the program's own; 128 + the signal that ended it; 127 when it cannot be started; 2 for wrong options.

mod guard;
mod options;

use std::process::ExitCode;

fn main() -> ExitCode {
    match options::parse(std::env::args_os().skip(1)) {
        Ok(options::Request::Help) => {
            print!("{}", options::HELP);
            ExitCode::SUCCESS
        }
        Ok(options::Request::Run(command)) => {
            guard::run(&command).unwrap_or_else(|error| fail(&error.to_string(), 127))
        }
        Err(error) => fail(&error, 2),
    }
}

fn fail(message: &str, status: u8) -> ExitCode {
    eprintln!("process_guard: {message}");
    ExitCode::from(status)
}
