//! Sleeping where no word of shared memory can be slept on: on a topic that does not exist yet,
//! and on a segment that is not mapped.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::path::Path;
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::eventfd::{EfdFlags, EventFd};
use nix::sys::inotify::{AddWatchFlags, InitFlags, Inotify};
use nix::unistd;

/// A watch that reports when a file appears in a directory.
#[derive(Debug)]
pub(crate) struct Watch {
    inotify: Inotify,
}

impl Watch {
    /// Starts to watch a directory.
    pub(crate) fn new(dir: &Path) -> io::Result<Watch> {
        let inotify = Inotify::init(InitFlags::IN_CLOEXEC | InitFlags::IN_NONBLOCK)?;
        inotify.add_watch(dir, AddWatchFlags::IN_CREATE | AddWatchFlags::IN_MOVED_TO)?;
        Ok(Watch { inotify })
    }
}

/// A flag of this process that wakes a sleeping thread.
#[derive(Debug)]
pub(crate) struct Event {
    fd: EventFd,
}

impl Event {
    /// Makes an event that is not raised.
    pub(crate) fn new() -> io::Result<Event> {
        let fd = EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)?;
        Ok(Event { fd })
    }

    /// Raises the event. Raising it again changes nothing.
    pub(crate) fn raise(&self) {
        // The only failure, a full counter, leaves the event raised.
        let _ = self.fd.write(1);
    }

    /// Lowers the event.
    pub(crate) fn clear(&self) {
        drain(self.fd.as_fd());
    }
}

/// Sleeps until the event is raised, a file appears in the watched directory or `timeout` has
/// passed. Clears both before it returns.
pub(crate) fn wait_for_either(event: &Event, watch: Option<&Watch>, timeout: Duration) {
    let timeout_ms = i32::try_from(timeout.as_micros().div_ceil(1000)).unwrap_or(i32::MAX);
    let timeout = PollTimeout::try_from(timeout_ms).unwrap_or(PollTimeout::MAX);
    let event = event.fd.as_fd();
    let watch = watch.map(|watch| watch.inotify.as_fd());
    let wait_for_input = |fd| PollFd::new(fd, PollFlags::POLLIN);
    // Without a watch both places have the event.
    let mut polled = [event, watch.unwrap_or(event)].map(wait_for_input);
    // Every result, an interruption too, is a reason to look again.
    let _ = poll(&mut polled, timeout);
    drain(event);
    watch.map(drain);
}

/// Reads all there is. The descriptor does not block.
fn drain(fd: BorrowedFd<'_>) {
    let mut buffer = [0; 4096];
    while unistd::read(fd, &mut buffer).is_ok_and(|got| got == buffer.len()) {}
}
