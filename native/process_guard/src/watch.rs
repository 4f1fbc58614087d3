//! The watch: the process that guards the guard. When the guard is killed, the kernel kills the
//! program too, but not the program's descendants. The watch kills those, and keeps the
//! supervisor's pipe open until then.

use std::ffi::OsString;
use std::io;
use std::os::unix::process::CommandExt;
use std::process::{ExitCode, ExitStatus};

use nix::sys::prctl;
use nix::sys::signal::{SigSet, Signal, kill};
use nix::unistd::Pid;

use crate::process::{self, Change};

/// The flag that marks a guard under a watch.
pub const WATCHED: &str = "--watched";

/// Runs the guard with `arguments` and returns its exit status when none of the guarded processes
/// is left.
pub fn run(arguments: &[OsString]) -> io::Result<ExitCode> {
    prctl::set_name(c"process_watch")?;
    prctl::set_child_subreaper(true)?;
    let signals = process::block_signals()?;
    let guard = spawn(arguments)?;
    let status = wait(guard, &signals)?;
    process::kill_children();
    Ok(ExitCode::from(process::shell_status(status)))
}

/// Starts the guard under a process name of its own, so that killing processes by name hits only
/// one of the two.
fn spawn(arguments: &[OsString]) -> io::Result<Pid> {
    let watch = Pid::this();
    let mut guard = std::process::Command::new("/proc/self/exe");
    guard.arg0("process_guard").arg(WATCHED).args(arguments);
    // SAFETY: the closure runs between fork and exec and makes only async-signal-safe system
    // calls.
    unsafe { guard.pre_exec(move || process::die_with_parent(watch, Signal::SIGTERM)) };
    Ok(Pid::from_raw(guard.spawn()?.id().cast_signed()))
}

fn wait(guard: Pid, signals: &SigSet) -> nix::Result<ExitStatus> {
    loop {
        if signals.wait()? != Signal::SIGCHLD {
            let _ = kill(guard, Signal::SIGTERM);
        }
        while let Some(change) = process::next_change(guard)? {
            match change {
                Change::Ended(status) => return Ok(status),
                // A stopped guard guards nothing.
                Change::Halted => kill(guard, Signal::SIGKILL)?,
                Change::Continued => {}
            }
        }
    }
}
