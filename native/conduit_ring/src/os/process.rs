//! This process and the others of the machine.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::thread::{Builder, JoinHandle};

use nix::sys::signal::{SigSet, SigmaskHow};
use nix::unistd::Uid;

use super::file::{FileId, Segment, names_in};

/// Returns the numbers of all processes that `/proc` shows.
pub(crate) fn process_ids() -> Vec<u32> {
    let names = names_in(Path::new("/proc")).unwrap_or_default();
    names
        .iter()
        .filter_map(|name| name.to_str()?.parse().ok())
        .collect()
}

/// Returns the mappings of a process, one on each line. The text is empty when the process has
/// ended or may not be inspected.
pub(crate) fn maps_of(pid: u32) -> String {
    let maps = std::fs::read(format!("/proc/{pid}/maps")).unwrap_or_default();
    String::from_utf8_lossy(&maps).into_owned()
}

/// Opens a file that another process has open, whatever its name is by now.
pub(crate) fn open_file_of(pid: u32, file: FileId) -> Option<Segment> {
    let directory = PathBuf::from(format!("/proc/{pid}/fd"));
    let names = names_in(&directory).ok()?;
    let is_file = |path: &PathBuf| {
        std::fs::metadata(path).is_ok_and(|found| FileId::of(&found) == file && found.is_file())
    };
    let path = names
        .iter()
        .map(|name| directory.join(name))
        .find(is_file)?;
    File::open(path).ok().map(Segment::from_file)
}

/// Returns the user that this process acts as.
pub(crate) fn own_user() -> u32 {
    Uid::effective().as_raw()
}

/// Returns whether this program was started with more rights than the user who started it has.
pub(crate) fn has_gained_rights() -> bool {
    // SAFETY: getauxval takes no pointer.
    unsafe { libc::getauxval(libc::AT_SECURE) != 0 }
}

/// Returns a random number other than 0.
pub(crate) fn random_id() -> io::Result<u64> {
    let mut bytes = [0_u8; 8];
    loop {
        // SAFETY: eight bytes are writable.
        let got = unsafe { libc::getrandom(bytes.as_mut_ptr().cast(), bytes.len(), 0) };
        match (got, u64::from_ne_bytes(bytes)) {
            (8, 0) => {}
            (8, id) => return Ok(id),
            _ => return Err(io::Error::last_os_error()),
        }
    }
}

/// Runs `call` in each child that this process forks from now on.
pub(crate) fn call_in_children(call: extern "C" fn()) {
    // SAFETY: the function lives for ever, and does nothing that a child with one thread may not.
    // The call fails only without memory; then children are taken for their parents.
    let _ = unsafe { libc::pthread_atfork(None, None, Some(call)) };
}

/// Starts a thread that receives no signals, so that they reach the program's own threads, one of
/// which may wait for them.
pub(crate) fn start_thread(
    name: &str,
    stack_bytes: usize,
    run: impl FnOnce() + Send + 'static,
) -> io::Result<JoinHandle<()>> {
    let thread = Builder::new().name(name.into()).stack_size(stack_bytes);
    // A new thread inherits the blocked signals of the thread that starts it.
    let own = SigSet::all().thread_swap_mask(SigmaskHow::SIG_SETMASK)?;
    let started = thread.spawn(run);
    // It cannot fail: the set is the one that was there before.
    let _ = own.thread_set_mask();
    started
}

/// Returns whether the calling thread would receive a signal that asks the program to end.
#[cfg(test)]
pub(crate) fn receives_signals() -> bool {
    let blocked = SigSet::thread_get_mask().unwrap();
    !blocked.contains(nix::sys::signal::Signal::SIGTERM)
}

/// Returns when this process started, in clock ticks since boot; 0 if `/proc` cannot be read.
pub(crate) fn process_start_time() -> u64 {
    const FIELDS_AFTER_NAME: usize = 19;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    after_name
        .split_whitespace()
        .nth(FIELDS_AFTER_NAME)
        .and_then(|ticks| ticks.parse().ok())
        .unwrap_or(0)
}
