//! The guard: runs the program from its start to the end of its last descendant.

use std::io::{self, PipeReader, PipeWriter, Read};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::process::CommandExt;
use std::process::{ExitCode, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::libc;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::prctl;
use nix::sys::signal::{Signal, kill, killpg};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use nix::unistd::{self, Pid, getppid};

use crate::limiter::Limiter;
use crate::options::Command;
use crate::process::{self, Change};
use crate::protocol::{Protocol, RequestReader};
use crate::splitter::LineSplitter;

/// How long a supervisor that reads nothing may delay the guard's exit. All guarded processes
/// have ended by then.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(10);

/// The most bytes that a pipe with any room takes without blocking.
const PIPE_BUF: usize = 4096;

/// The most bytes encoded ahead of the supervisor's reads.
const AHEAD: usize = 16 * 1024;

/// Runs `command` to its end and returns its exit status as the guard's own.
pub fn run(command: &Command) -> io::Result<ExitCode> {
    prctl::set_name(c"process_guard")?;
    prctl::set_child_subreaper(true)?;
    let signals = process::block_signals()?;
    let signals = SignalFd::with_flags(&signals, SfdFlags::SFD_CLOEXEC | SfdFlags::SFD_NONBLOCK)?;
    // SAFETY: a system call with a number alone. A higher nice value is always permitted; the
    // program inherits it.
    unsafe { libc::nice(command.nice) };
    let (output, output_writer) = io::pipe()?;
    let program = spawn(command, output_writer)?;
    let mut guard = Guard::new(command, program, signals, output);
    let status = guard.supervise()?;
    signal_group(program, Signal::SIGKILL);
    process::kill_children();
    guard.flush_output();
    // A stopped watch could not exit.
    let _ = kill(getppid(), Signal::SIGCONT);
    Ok(ExitCode::from(process::shell_status(status)))
}

fn spawn(command: &Command, output: PipeWriter) -> io::Result<Pid> {
    let guard = Pid::this();
    let mut program = std::process::Command::new(&command.program);
    program
        .args(&command.arguments)
        .stdin(Stdio::null())
        .stdout(output.try_clone()?)
        .stderr(output)
        .process_group(0);
    // SAFETY: the closure runs between fork and exec and makes only async-signal-safe system
    // calls.
    unsafe { program.pre_exec(move || process::die_with_parent(guard, Signal::SIGKILL)) };
    let child = program.spawn().map_err(|error| {
        io::Error::new(
            error.kind(),
            format!("cannot run {}: {error}", command.program.display()),
        )
    })?;
    Ok(Pid::from_raw(child.id().cast_signed()))
}

struct Guard {
    program: Pid,
    signals: SignalFd,
    grace: Duration,
    halt: Option<Duration>,
    stdin_open: bool,
    requests: RequestReader,
    output: Option<PipeReader>,
    splitter: LineSplitter,
    limiter: Limiter,
    protocol: Protocol,
    credits: u32,
    unsent: Vec<u8>,
    stop: bool,
    acknowledged: bool,
    kill_at: Option<Instant>,
    halted_until: Option<Instant>,
}

impl Guard {
    fn new(command: &Command, program: Pid, signals: SignalFd, output: PipeReader) -> Guard {
        Guard {
            program,
            signals,
            grace: command.grace,
            halt: command.halt,
            stdin_open: true,
            requests: RequestReader::default(),
            output: Some(output),
            splitter: LineSplitter::default(),
            limiter: Limiter::new(command.lines_per_second, Instant::now()),
            protocol: command.protocol,
            credits: command.protocol.initial_credits(),
            unsent: Vec::new(),
            stop: false,
            acknowledged: command.protocol == Protocol::Lines,
            kill_at: None,
            halted_until: None,
        }
    }

    fn supervise(&mut self) -> io::Result<ExitStatus> {
        loop {
            self.limiter.recover(Instant::now());
            self.encode();
            self.exchange()?;
            if let Some(status) = self.reap()? {
                return Ok(status);
            }
            self.end_program_when_due(Instant::now());
        }
    }

    /// Waits for an event and performs the reads and writes that are ready.
    fn exchange(&mut self) -> io::Result<()> {
        let [signal, request, output, room] = self.poll(self.deadline())?;
        if signal {
            self.read_signals()?;
        }
        if request {
            self.read_requests()?;
        }
        if output {
            self.read_output();
        }
        if room {
            self.send();
        }
        Ok(())
    }

    /// Returns which of signals, standard input, the program's output and standard output are
    /// ready.
    fn poll(&self, until: Option<Instant>) -> io::Result<[bool; 4]> {
        let (stdin, stdout) = (io::stdin(), io::stdout());
        let watched: [Option<(BorrowedFd, PollFlags)>; 4] = [
            Some((self.signals.as_fd(), PollFlags::POLLIN)),
            self.stdin_open
                .then_some((stdin.as_fd(), PollFlags::POLLIN)),
            self.output
                .as_ref()
                .map(|pipe| (pipe.as_fd(), PollFlags::POLLIN)),
            (!self.unsent.is_empty()).then_some((stdout.as_fd(), PollFlags::POLLOUT)),
        ];
        let mut fds: Vec<PollFd> = watched
            .iter()
            .flatten()
            .map(|&(fd, flags)| PollFd::new(fd, flags))
            .collect();
        match poll(&mut fds, timeout_until(until)) {
            Ok(_) => {}
            Err(Errno::EINTR) => return Ok([false; 4]),
            Err(error) => return Err(error.into()),
        }
        let mut ready = fds.iter().map(|fd| fd.any().unwrap_or(false));
        Ok(watched.map(|fd| fd.is_some() && ready.next().unwrap_or(false)))
    }

    fn deadline(&self) -> Option<Instant> {
        [self.kill_at, self.halted_until, self.limiter.due()]
            .into_iter()
            .flatten()
            .min()
    }

    fn read_signals(&mut self) -> nix::Result<()> {
        while let Some(info) = self.signals.read_signal()? {
            self.stop |= info.ssi_signo != Signal::SIGCHLD as u32;
        }
        Ok(())
    }

    fn read_requests(&mut self) -> nix::Result<()> {
        let mut bytes = [0; 4096];
        match unistd::read(io::stdin().as_fd(), &mut bytes) {
            Ok(0) => {
                self.stdin_open = false;
                self.stop = true;
                self.acknowledged = true;
            }
            Ok(count) => {
                let request = self.requests.read(self.protocol, &bytes[..count]);
                self.credits = self.credits.saturating_add(request.credits);
                self.stop |= request.stop;
                self.acknowledged |= request.acknowledged;
            }
            Err(Errno::EINTR | Errno::EAGAIN) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    fn read_output(&mut self) {
        let mut bytes = [0; 64 * 1024];
        let now = Instant::now();
        match self.output.as_mut().map(|pipe| pipe.read(&mut bytes)) {
            Some(Ok(count)) if count > 0 => {
                let limiter = &mut self.limiter;
                self.splitter
                    .split(&bytes[..count], |line| limiter.push(line, now));
            }
            Some(Err(error)) if error.kind() == io::ErrorKind::Interrupted => {}
            _ => self.output = None,
        }
    }

    /// Encodes the items that may be sent to the supervisor now.
    fn encode(&mut self) {
        while self.credits > 0 && self.unsent.len() < AHEAD {
            let Some(item) = self.limiter.next() else {
                return;
            };
            self.unsent.extend(self.protocol.encode(&item));
            if self.protocol != Protocol::Lines {
                self.credits -= 1;
            }
        }
    }

    fn send(&mut self) {
        let some = &self.unsent[..self.unsent.len().min(PIPE_BUF)];
        match unistd::write(io::stdout().as_fd(), some) {
            Ok(count) => drop(self.unsent.drain(..count)),
            Err(Errno::EINTR | Errno::EAGAIN) => {}
            // The reader has closed the pipe; standard input closes too and ends the program.
            Err(_) => self.unsent.clear(),
        }
    }

    fn reap(&mut self) -> nix::Result<Option<ExitStatus>> {
        while let Some(change) = process::next_change(self.program)? {
            match change {
                Change::Ended(status) => return Ok(Some(status)),
                Change::Halted => self.halted_until = self.halt.map(|halt| Instant::now() + halt),
                Change::Continued => self.halted_until = None,
            }
        }
        Ok(None)
    }

    fn end_program_when_due(&mut self, now: Instant) {
        match self.kill_at {
            None if self.stop => {
                signal_group(self.program, Signal::SIGTERM);
                self.kill_at = Some(now + self.grace);
                self.halted_until = None;
            }
            Some(at) if now >= at => {
                signal_group(self.program, Signal::SIGKILL);
                self.kill_at = Some(now + self.grace.max(Duration::from_millis(10)));
            }
            _ => {}
        }
        if self.halted_until.is_some_and(|until| now >= until) {
            self.halted_until = None;
            self.unsent.extend(self.protocol.halted());
            signal_group(self.program, Signal::SIGKILL);
        }
    }

    /// Sends the rest of the program's output. With frames, the guard then waits until the
    /// supervisor acknowledges the end: a BEAM that writes to a closed pipe takes that for a
    /// failure and loses the output that it has not read.
    fn flush_output(&mut self) {
        while self
            .poll(Some(Instant::now()))
            .is_ok_and(|[_, _, output, _]| output)
        {
            self.read_output();
        }
        self.output = None;
        if let Some(line) = self.splitter.finish() {
            self.limiter.push(line, Instant::now());
        }
        self.limiter.finish();
        while let Some(item) = self.limiter.next() {
            self.unsent.extend(self.protocol.encode(&item));
        }
        self.unsent.extend(self.protocol.end());
        self.await_acknowledgement(Instant::now() + FLUSH_TIMEOUT);
    }

    fn await_acknowledgement(&mut self, until: Instant) {
        while !(self.unsent.is_empty() && self.acknowledged) && Instant::now() < until {
            let Ok([signal, request, _, room]) = self.poll(Some(until)) else {
                return;
            };
            if room {
                self.send();
            }
            if (signal && self.read_signals().is_err())
                || (request && self.read_requests().is_err())
            {
                return;
            }
        }
    }
}

fn timeout_until(deadline: Option<Instant>) -> PollTimeout {
    let Some(deadline) = deadline else {
        return PollTimeout::NONE;
    };
    let left = deadline.saturating_duration_since(Instant::now());
    let left = if left.is_zero() {
        left
    } else {
        left + Duration::from_millis(1)
    };
    PollTimeout::try_from(left).unwrap_or(PollTimeout::MAX)
}

/// Sends `signal` to the program's process group. A group that has ended already is fine.
fn signal_group(program: Pid, signal: Signal) {
    let _ = killpg(program, signal);
}
