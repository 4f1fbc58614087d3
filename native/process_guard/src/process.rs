//! Operations on processes that the guard and its watch share.

use std::io;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;
use std::time::Duration;

use nix::errno::Errno;
use nix::sys::prctl;
use nix::sys::signal::{SigSet, Signal, kill};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::{Pid, getppid};

/// The pause between checks for remaining adopted descendants.
const REAP_PERIOD: Duration = Duration::from_millis(2);

/// Prepares a forked process before it executes a program: the kernel sends it `signal` when its
/// parent dies, and its signal mask is empty again. Fails when the parent has died already.
pub fn die_with_parent(parent: Pid, signal: Signal) -> io::Result<()> {
    prctl::set_pdeathsig(signal)?;
    SigSet::empty().thread_set_mask()?;
    if getppid() == parent {
        Ok(())
    } else {
        Err(Errno::ESRCH.into())
    }
}

/// Blocks the signals that a guard waits for: SIGCHLD and the requests to end.
pub fn block_signals() -> nix::Result<SigSet> {
    let mut set = SigSet::empty();
    for signal in [
        Signal::SIGCHLD,
        Signal::SIGTERM,
        Signal::SIGINT,
        Signal::SIGHUP,
    ] {
        set.add(signal);
    }
    set.thread_block()?;
    Ok(set)
}

/// A change of a child's state.
pub enum Change {
    Ended(ExitStatus),
    Halted,
    Continued,
}

/// Returns the next change of `child`, or `None`. Reaps other children that have ended.
pub fn next_change(child: Pid) -> nix::Result<Option<Change>> {
    let flags = WaitPidFlag::WNOHANG | WaitPidFlag::WUNTRACED | WaitPidFlag::WCONTINUED;
    loop {
        let change = match waitpid(None, Some(flags)) {
            Ok(WaitStatus::StillAlive) | Err(Errno::ECHILD) => return Ok(None),
            Err(Errno::EINTR) => continue,
            Err(error) => return Err(error),
            Ok(status) if status.pid() != Some(child) => continue,
            Ok(WaitStatus::Exited(_, code)) => Change::Ended(ExitStatus::from_raw(code << 8)),
            Ok(WaitStatus::Signaled(_, signal, _)) => {
                Change::Ended(ExitStatus::from_raw(signal as i32))
            }
            Ok(WaitStatus::Stopped(..)) => Change::Halted,
            Ok(WaitStatus::Continued(_)) => Change::Continued,
            Ok(_) => continue,
        };
        return Ok(Some(change));
    }
}

/// Kills all children of this process, adopted ones too, until none is left.
pub fn kill_children() {
    while waitpid(None, Some(WaitPidFlag::WNOHANG)) != Err(Errno::ECHILD) {
        for child in children_of(Pid::this()) {
            let _ = kill(child, Signal::SIGKILL);
        }
        std::thread::sleep(REAP_PERIOD);
    }
}

/// Reads each process's own entry, because boards may lack the kernel's list of children, which
/// is a build option.
fn children_of(parent: Pid) -> Vec<Pid> {
    let Ok(entries) = std::fs::read_dir("/proc") else {
        return Vec::new();
    };
    entries
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok())
        .map(Pid::from_raw)
        .filter(|pid| parent_of(*pid) == Some(parent))
        .collect()
}

/// Reads the second field after the command's name, which is in parentheses and may contain any
/// character.
fn parent_of(pid: Pid) -> Option<Pid> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    let (_, after_name) = stat.rsplit_once(')')?;
    after_name
        .split_whitespace()
        .nth(1)?
        .parse()
        .ok()
        .map(Pid::from_raw)
}

/// Converts a status as a shell does: the exit code, or 128 + the signal that ended the process.
pub fn shell_status(status: ExitStatus) -> u8 {
    let code = status
        .code()
        .unwrap_or_else(|| 128 + status.signal().unwrap_or(0));
    u8::try_from(code).unwrap_or(u8::MAX)
}
