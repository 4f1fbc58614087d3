//! The guarded program, from its start to the end of its last descendant.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{ExitCode, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::libc;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::prctl;
use nix::sys::signal::{SigSet, Signal, kill, killpg};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::{Pid, getppid};

use crate::options::Command;

/// How often the guard looks whether the last adopted descendant is gone.
const REAP_PERIOD: Duration = Duration::from_millis(2);

/// Runs `command` to its end and gives its exit status as the guard's own.
pub fn run(command: &Command) -> io::Result<ExitCode> {
    prctl::set_child_subreaper(true)?;
    let signals = watch_signals()?;
    let program = spawn(command)?;
    let status = supervise(program, &signals, command.grace)?;
    kill_descendants(program);
    Ok(ExitCode::from(shell_status(status)))
}

/// The signals are read from a descriptor, in the same wait as standard input: nothing can come between.
fn watch_signals() -> nix::Result<SignalFd> {
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
    SignalFd::with_flags(&set, SfdFlags::SFD_CLOEXEC | SfdFlags::SFD_NONBLOCK)
}

fn spawn(command: &Command) -> io::Result<Pid> {
    let (guard, nice) = (Pid::this(), command.nice);
    let mut program = std::process::Command::new(&command.program);
    program
        .args(&command.arguments)
        .stdin(Stdio::null())
        .process_group(0);
    // SAFETY: the closure runs between fork and exec and makes only async-signal-safe system calls.
    unsafe { program.pre_exec(move || prepare(guard, nice)) };
    let child = program.spawn().map_err(|error| {
        io::Error::new(
            error.kind(),
            format!("cannot run {}: {error}", command.program.display()),
        )
    })?;
    Ok(Pid::from_raw(child.id().cast_signed()))
}

/// In the program's process, before it becomes the program: it is to die with `guard`, which may be dead already, to be
/// polite, and to have signals again.
fn prepare(guard: Pid, nice: i32) -> io::Result<()> {
    prctl::set_pdeathsig(Signal::SIGKILL)?;
    // SAFETY: a system call on a number alone. Giving way is always allowed.
    unsafe { libc::nice(nice) };
    SigSet::empty().thread_set_mask()?;
    if getppid() == guard {
        Ok(())
    } else {
        Err(Errno::ESRCH.into())
    }
}

fn supervise(program: Pid, signals: &SignalFd, grace: Duration) -> nix::Result<ExitStatus> {
    let mut kill_at = None;
    loop {
        let stop = wait_for_event(signals, kill_at)?;
        if let Some(status) = reap(program)? {
            return Ok(status);
        }
        match kill_at {
            None if stop => {
                signal_group(program, Signal::SIGTERM);
                kill_at = Some(Instant::now() + grace);
            }
            Some(at) if Instant::now() >= at => signal_group(program, Signal::SIGKILL),
            _ => {}
        }
    }
}

/// Sleeps until something happened; true when that is a reason to stop the program.
fn wait_for_event(signals: &SignalFd, kill_at: Option<Instant>) -> nix::Result<bool> {
    let stdin = io::stdin();
    let watched: &[BorrowedFd] = &[signals.as_fd(), stdin.as_fd()];
    // Once the program is being stopped, standard input has nothing more to say, and at its end would wake the wait for ever.
    let count = if kill_at.is_some() { 1 } else { 2 };
    let mut fds: Vec<PollFd> = watched[..count]
        .iter()
        .map(|fd| PollFd::new(*fd, PollFlags::POLLIN))
        .collect();
    match poll(&mut fds, timeout_until(kill_at)) {
        Ok(_) | Err(Errno::EINTR) => {}
        Err(error) => return Err(error),
    }
    let stdin_spoke = fds
        .get(1)
        .is_some_and(|fd| fd.revents().is_some_and(|events| !events.is_empty()));
    Ok(stdin_spoke || stop_signal(signals)?)
}

fn timeout_until(deadline: Option<Instant>) -> PollTimeout {
    let Some(deadline) = deadline else {
        return PollTimeout::NONE;
    };
    let left = deadline.saturating_duration_since(Instant::now()) + Duration::from_millis(1);
    PollTimeout::try_from(left).unwrap_or(PollTimeout::MAX)
}

fn stop_signal(signals: &SignalFd) -> nix::Result<bool> {
    let mut stop = false;
    while let Some(info) = signals.read_signal()? {
        stop |= info.ssi_signo != Signal::SIGCHLD as u32;
    }
    Ok(stop)
}

/// Collects every child that has ended; the program's status when it is among them.
fn reap(program: Pid) -> nix::Result<Option<ExitStatus>> {
    let mut ended = None;
    loop {
        match waitpid(None, Some(WaitPidFlag::WNOHANG)) {
            Ok(WaitStatus::Exited(pid, code)) if pid == program => {
                ended = Some(ExitStatus::from_raw(code << 8))
            }
            Ok(WaitStatus::Signaled(pid, signal, _)) if pid == program => {
                ended = Some(ExitStatus::from_raw(signal as i32));
            }
            Ok(WaitStatus::StillAlive) | Err(Errno::ECHILD) => return Ok(ended),
            Ok(_) | Err(Errno::EINTR) => {}
            Err(error) => return Err(error),
        }
    }
}

/// A group that is gone already is what was wanted.
fn signal_group(program: Pid, signal: Signal) {
    let _ = killpg(program, signal);
}

/// Kills what the program left behind: its group, then whatever the guard has adopted, until nobody is left.
fn kill_descendants(program: Pid) {
    signal_group(program, Signal::SIGKILL);
    while waitpid(None, Some(WaitPidFlag::WNOHANG)) != Err(Errno::ECHILD) {
        for child in children_of(Pid::this()) {
            let _ = kill(child, Signal::SIGKILL);
        }
        std::thread::sleep(REAP_PERIOD);
    }
}

/// Read from every process's own entry: the kernel's list of children is an option that boards may lack.
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

/// The second field after the command's name, which stands in parentheses and may hold any character.
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

fn shell_status(status: ExitStatus) -> u8 {
    let code = status
        .code()
        .unwrap_or_else(|| 128 + status.signal().unwrap_or(0));
    u8::try_from(code).unwrap_or(u8::MAX)
}
