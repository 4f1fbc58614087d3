//! Locks on single bytes of a segment. They show which processes live, and the kernel frees them.
//!
//! These are open-file-description locks (`F_OFD_SETLK`). They belong to the open file, not to
//! the process or thread, so that one process may hold several. The kernel frees them when the
//! open file ends, SIGKILL included. The open file ends with its last descriptor and its last
//! mapping: a mapping that a lease keeps, or a descriptor that a forked child shares, keeps the
//! locks too. Hence every lock is freed by [`Segment::unlock`] when its holder closes.

use std::io;

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, fcntl};

use super::file::Segment;

impl Segment {
    /// Takes the lock on one byte. Returns `false` when another open file has it.
    pub(crate) fn try_lock(&self, byte: u64) -> io::Result<bool> {
        match fcntl(
            self.file(),
            FcntlArg::F_OFD_SETLK(&lock_of(byte, libc::F_WRLCK)),
        ) {
            Ok(_) => Ok(true),
            Err(Errno::EAGAIN | Errno::EACCES) => Ok(false),
            Err(errno) => Err(errno.into()),
        }
    }

    /// Frees the lock on one byte.
    pub(crate) fn unlock(&self, byte: u64) -> io::Result<()> {
        fcntl(
            self.file(),
            FcntlArg::F_OFD_SETLK(&lock_of(byte, libc::F_UNLCK)),
        )?;
        Ok(())
    }

    /// Returns whether another open file has the lock on this byte.
    pub(crate) fn is_locked(&self, byte: u64) -> io::Result<bool> {
        let mut lock = lock_of(byte, libc::F_WRLCK);
        fcntl(self.file(), FcntlArg::F_OFD_GETLK(&mut lock))?;
        Ok(i32::from(lock.l_type) != libc::F_UNLCK)
    }

    /// Returns whether no other process has the file open for writing, or mapped for writing.
    ///
    /// The kernel grants a write lease just then. Returns `false` as well when this process may
    /// not ask for a lease. A process that opens the file while the lease is held makes the
    /// kernel send a signal, whose default would end this process; hence SIGURG, which is ignored
    /// by default.
    pub(crate) fn is_unused(&self) -> bool {
        let granted = self.lease_call(F_SETSIG, libc::SIGURG).is_ok()
            && self.lease_call(libc::F_SETLEASE, libc::F_WRLCK).is_ok();
        if granted {
            let _ = self.lease_call(libc::F_SETLEASE, libc::F_UNLCK);
        }
        granted
    }

    fn lease_call(&self, command: i32, argument: i32) -> io::Result<()> {
        // SAFETY: both commands, F_SETSIG and F_SETLEASE, take an int and no pointer.
        Errno::result(unsafe { libc::fcntl(self.fd(), command, argument) })?;
        Ok(())
    }
}

/// Linux's number, which libc does not name.
const F_SETSIG: i32 = 10;

/// One byte's lock. The structure is glibc's own, with offsets of 32 bits on 32-bit machines: its
/// `fcntl` makes 64 of them for the kernel. The structure with offsets of 64 bits would be
/// misread there, as a lock on other bytes.
fn lock_of(byte: u64, kind: i32) -> libc::flock {
    libc::flock {
        l_type: kind as _,
        l_whence: libc::SEEK_SET as _,
        l_start: byte as _,
        l_len: 1,
        l_pid: 0,
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::path::PathBuf;
    use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
    use std::thread;

    use super::super::file::Access;
    use super::*;

    /// A file that is removed afterwards. It is no topic, which other programs might open.
    struct ScratchFile(PathBuf);

    impl ScratchFile {
        fn new(label: &str) -> ScratchFile {
            let name = format!("conduit_{label}_{}", std::process::id());
            let path = std::env::temp_dir().join(name);
            File::create(&path).unwrap();
            ScratchFile(path)
        }

        fn open(&self) -> io::Result<Segment> {
            Segment::open(&self.0, Access::Write)
        }
    }

    impl Drop for ScratchFile {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    #[test]
    fn a_lock_covers_its_byte_and_no_other() {
        let file = ScratchFile::new("lock");
        let [one, other] = [0, 1].map(|_| file.open().unwrap());
        assert!(one.try_lock(64).unwrap());
        for byte in [0, 63, 65, 192, 1152] {
            assert!(!other.is_locked(byte).unwrap(), "{byte}");
        }
        assert!(other.is_locked(64).unwrap() && !other.try_lock(64).unwrap());
        one.unlock(64).unwrap();
        assert!(other.try_lock(64).unwrap());
    }

    #[test]
    fn asking_whether_a_file_is_unused_survives_that_it_is_opened_just_then() {
        let file = ScratchFile::new("lease");
        let segment = file.open().unwrap();
        let refused = AtomicBool::new(false);
        thread::scope(|scope| {
            scope.spawn(|| {
                while file.open().is_ok() {}
                refused.store(true, Relaxed);
            });
            while !refused.load(Relaxed) {
                segment.is_unused();
            }
        });
        assert!(segment.is_unused());
    }
}
