//! The guard's own guard. When the guard is killed, the kernel kills the program with it, but not
//! what the program has started and let go: that falls to the watch, which ends it. The watch
//! keeps the supervisor's pipe open until then.

use std::ffi::OsString;
use std::io;
use std::os::unix::process::CommandExt;
use std::process::{ExitCode, ExitStatus};

use nix::sys::prctl;
use nix::sys::signal::{SigSet, Signal, kill};
use nix::unistd::Pid;

use crate::process::{self, Change};

/// How the guard is told that it has a watch.
pub const WATCHED: &str = "--watched";

/// Runs the guard with these arguments and gives its exit status, when nothing is left that it
/// guarded.
pub fn run(arguments: &[OsString]) -> io::Result<ExitCode> {
    prctl::set_name(c"process_watch")?;
    prctl::set_child_subreaper(true)?;
    let signals = process::block_signals()?;
    let guard = spawn(arguments)?;
    let status = wait(guard, &signals)?;
    process::kill_children();
    Ok(ExitCode::from(process::shell_status(status)))
}

/// The guard has a name of its own, so that who ends processes by their name meets one of the
/// two.
fn spawn(arguments: &[OsString]) -> io::Result<Pid> {
    let watch = Pid::this();
    let mut guard = std::process::Command::new("/proc/self/exe");
    guard.arg0("process_guard").arg(WATCHED).args(arguments);
    // SAFETY: the closure runs between fork and exec and makes only async-signal-safe system
    // calls.
    unsafe { guard.pre_exec(move || process::follow(watch, Signal::SIGTERM)) };
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
                // A guard that is halted guards nothing.
                Change::Halted => kill(guard, Signal::SIGKILL)?,
                Change::Continued => {}
            }
        }
    }
}
