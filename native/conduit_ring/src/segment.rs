//! Everything that the operating system does for a ring: files, locks, mappings, futexes, clocks. No other file calls it.

use std::ffi::{CString, OsString};
use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd, RawFd};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt, PermissionsExt, fchown};
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::atomic::AtomicU32;
use std::time::Duration;

use crate::topic::directory;

/// An open segment file. Locks belong to it, not to the process.
#[derive(Debug)]
pub(crate) struct Segment {
    file: File,
}

/// The names in a directory.
pub(crate) fn names_in(directory: &Path) -> io::Result<Vec<OsString>> {
    std::fs::read_dir(directory)?
        .map(|entry| Ok(entry?.file_name()))
        .collect()
}

/// What a path leads to, seen from an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Name {
    /// To this file.
    Same,
    /// To another file.
    Other,
    /// Nowhere.
    Missing,
}

/// Whose a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FileOwner {
    pub(crate) user: u32,
    pub(crate) group: u32,
}

impl FileOwner {
    fn of(found: &Metadata) -> FileOwner {
        FileOwner {
            user: found.uid(),
            group: found.gid(),
        }
    }
}

/// Which file it is, as /proc/PID/maps tells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FileId {
    /// Major and minor number.
    pub(crate) device: (u32, u32),
    pub(crate) inode: u64,
}

impl FileId {
    fn of(found: &Metadata) -> FileId {
        FileId {
            device: (libc::major(found.dev()), libc::minor(found.dev())),
            inode: found.ino(),
        }
    }
}

/// The processes that there are.
pub(crate) fn processes() -> Vec<u32> {
    let names = names_in(Path::new("/proc")).unwrap_or_default();
    names
        .iter()
        .filter_map(|name| name.to_str()?.parse().ok())
        .collect()
}

/// The mappings of a process, one a line; empty of one that is gone or may not be looked at.
pub(crate) fn maps_of(pid: u32) -> String {
    let maps = std::fs::read(format!("/proc/{pid}/maps")).unwrap_or_default();
    String::from_utf8_lossy(&maps).into_owned()
}

/// A file that a process has open, opened anew.
pub(crate) fn opened_by(pid: u32, file: FileId) -> Option<Segment> {
    let directory = PathBuf::from(format!("/proc/{pid}/fd"));
    let names = names_in(&directory).ok()?;
    let is_it = |path: &PathBuf| {
        std::fs::metadata(path).is_ok_and(|found| FileId::of(&found) == file && found.is_file())
    };
    let path = names.iter().map(|name| directory.join(name)).find(is_it)?;
    let file = File::open(path).ok()?;
    Some(Segment { file })
}

/// Whose the file at a path is; of a symbolic link, the link's.
pub(crate) fn owner_of(path: &Path) -> io::Result<FileOwner> {
    std::fs::symlink_metadata(path).map(|found| FileOwner::of(&found))
}

/// The user that this process acts as.
pub(crate) fn own_user() -> u32 {
    // SAFETY: geteuid takes nothing and cannot fail.
    unsafe { libc::geteuid() }
}

/// Whether this program was started with more rights than the user who started it has.
pub(crate) fn has_gained_rights() -> bool {
    // SAFETY: getauxval takes no pointer.
    unsafe { libc::getauxval(libc::AT_SECURE) != 0 }
}

/// Whether files get the group of the directory of segments, whoever makes them.
pub(crate) fn directory_gives_group() -> bool {
    const SET_GROUP: u32 = 0o2000;
    std::fs::metadata(directory()).map_or(true, |found| found.mode() & SET_GROUP != 0)
}

/// A small file as text; none is empty.
pub(crate) fn text_of(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

/// How a segment is opened and mapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    Read,
    Write,
}

impl Segment {
    /// Opens a file that exists; symbolic links are not followed.
    pub(crate) fn open(path: &Path, access: Access) -> io::Result<Segment> {
        let file = OpenOptions::new()
            .read(true)
            .write(access == Access::Write)
            .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK | libc::O_CLOEXEC)
            .open(path)?;
        Ok(Segment { file })
    }

    /// A new file without a name, zeroed, all of its pages allocated.
    pub(crate) fn create(
        dir: &Path,
        len: u64,
        mode: u32,
        group: Option<u32>,
    ) -> io::Result<Segment> {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .mode(mode)
            .custom_flags(libc::O_TMPFILE | libc::O_CLOEXEC)
            .open(dir)?;
        if group.is_some() {
            fchown(&file, None, group)?;
        }
        file.set_permissions(Permissions::from_mode(mode))?;
        let segment = Segment { file };
        segment.allocate(len)?;
        Ok(segment)
    }

    /// Allocates every page of the first `len` bytes, so that a full file system is an error now and no signal later.
    pub(crate) fn allocate(&self, len: u64) -> io::Result<()> {
        let len = len
            .try_into()
            .map_err(|_| io::Error::from_raw_os_error(libc::EFBIG))?;
        // SAFETY: posix_fallocate takes no pointer.
        match unsafe { libc::posix_fallocate(self.fd(), 0, len) } {
            0 => Ok(()),
            errno => Err(io::Error::from_raw_os_error(errno)),
        }
    }

    /// Gives a file made by [`Segment::create`] its name; `AlreadyExists` when it is taken.
    pub(crate) fn link(&self, path: &Path) -> io::Result<()> {
        let from = CString::new(format!("/proc/self/fd/{}", self.fd()))?;
        let to = CString::new(path.as_os_str().as_bytes())?;
        let (cwd, follow) = (libc::AT_FDCWD, libc::AT_SYMLINK_FOLLOW);
        // SAFETY: both strings are NUL-terminated and outlive the call.
        check(unsafe { libc::linkat(cwd, from.as_ptr(), cwd, to.as_ptr(), follow) }).map(drop)
    }

    pub(crate) fn is_regular(&self) -> io::Result<bool> {
        Ok(self.file.metadata()?.is_file())
    }

    pub(crate) fn len(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    /// The first `N` bytes, or `None` in a file that is shorter.
    pub(crate) fn head<const N: usize>(&self) -> io::Result<Option<[u8; N]>> {
        let mut bytes = [0; N];
        match self.file.read_exact_at(&mut bytes, 0) {
            Ok(()) => Ok(Some(bytes)),
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
            Err(e) => Err(e),
        }
    }

    /// Fills `bytes` from the file at `offset`.
    pub(crate) fn read_at(&self, bytes: &mut [u8], offset: u64) -> io::Result<()> {
        self.file.read_exact_at(bytes, offset)
    }

    /// Fills `len` bytes at `to` from the file at `offset`. `UnexpectedEof` where the file ends before.
    ///
    /// # Safety
    /// `to` is valid for writes of `len` bytes.
    pub(crate) unsafe fn read_raw_at(
        &self,
        to: *mut u8,
        len: usize,
        offset: u64,
    ) -> io::Result<()> {
        let mut done = 0;
        while done < len {
            let at = offset + done as u64;
            let to = to.wrapping_add(done).cast();
            // SAFETY: `len - done` bytes are writable there by the caller's promise.
            match unsafe { libc::pread64(self.fd(), to, len - done, at as i64) } {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                got if got > 0 => done += got as usize,
                _ => {
                    let error = io::Error::last_os_error();
                    if error.kind() != io::ErrorKind::Interrupted {
                        return Err(error);
                    }
                }
            }
        }
        Ok(())
    }

    pub(crate) fn owner(&self) -> io::Result<FileOwner> {
        self.file.metadata().map(|found| FileOwner::of(&found))
    }

    pub(crate) fn id(&self) -> io::Result<FileId> {
        self.file.metadata().map(|found| FileId::of(&found))
    }

    /// Permissions and group.
    pub(crate) fn access_rights(&self) -> io::Result<(u32, u32)> {
        self.file
            .metadata()
            .map(|found| (found.mode() & 0o7777, found.gid()))
    }

    /// Whether this and the other one are of one file.
    pub(crate) fn is_same(&self, other: &Segment) -> io::Result<bool> {
        Ok(self.id()? == other.id()?)
    }

    /// Copies what lies from `from` to `to` in the other one.
    pub(crate) fn copy_from(&self, other: &Segment, from: u64, to: u64) -> io::Result<()> {
        const PIECE: u64 = 1 << 20;
        let mut piece = vec![0; PIECE.min(to - from) as usize];
        let mut at = from;
        while at < to {
            let len = PIECE.min(to - at);
            let bytes = &mut piece[..len as usize];
            other.read_at(bytes, at)?;
            self.file.write_all_at(bytes, at)?;
            at += len;
        }
        Ok(())
    }

    pub(crate) fn write_head(&self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all_at(bytes, 0)
    }

    /// Whether `path` still leads to this file.
    pub(crate) fn name(&self, path: &Path) -> io::Result<Name> {
        let own = self.file.metadata()?;
        match std::fs::symlink_metadata(path) {
            Ok(found) if (found.dev(), found.ino()) == (own.dev(), own.ino()) => Ok(Name::Same),
            Ok(_) => Ok(Name::Other),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(Name::Missing),
            Err(e) => Err(e),
        }
    }

    /// Removes `path` if it leads to this file.
    pub(crate) fn unlink(&self, path: &Path) -> io::Result<()> {
        match self.name(path)? {
            Name::Same => std::fs::remove_file(path),
            Name::Other | Name::Missing => Ok(()),
        }
    }

    /// Takes the lock on one byte; `false` when another open file has it. The kernel frees it when this file is closed
    /// by whatever end, SIGKILL too.
    pub(crate) fn try_lock(&self, byte: u64) -> io::Result<bool> {
        match self.lock_call(libc::F_OFD_SETLK, &mut lock_of(byte, libc::F_WRLCK)) {
            Ok(()) => Ok(true),
            Err(e) if matches!(e.raw_os_error(), Some(libc::EAGAIN | libc::EACCES)) => Ok(false),
            Err(e) => Err(e),
        }
    }

    pub(crate) fn unlock(&self, byte: u64) -> io::Result<()> {
        self.lock_call(libc::F_OFD_SETLK, &mut lock_of(byte, libc::F_UNLCK))
    }

    /// Whether another open file has the lock on this byte.
    pub(crate) fn is_locked(&self, byte: u64) -> io::Result<bool> {
        let mut lock = lock_of(byte, libc::F_WRLCK);
        self.lock_call(libc::F_OFD_GETLK, &mut lock)?;
        Ok(i32::from(lock.l_type) != libc::F_UNLCK)
    }

    fn lock_call(&self, command: i32, lock: &mut Flock) -> io::Result<()> {
        // SAFETY: the commands used here take a pointer to a flock, which is exclusively borrowed.
        check(unsafe { libc::fcntl(self.fd(), command, ptr::from_mut(lock)) }).map(drop)
    }

    /// Whether nobody else has the file open for writing or mapped so. A write lease is granted just then; who may not ask
    /// for one cannot know. Whoever opens the file while the lease is held is what the signal would tell, whose default
    /// would end this process; SIGURG is ignored by default.
    pub(crate) fn is_unused(&self) -> bool {
        let ask = |command, argument: i32| {
            // SAFETY: the commands used here take an int.
            check(unsafe { libc::fcntl(self.fd(), command, argument) })
        };
        let granted = ask(F_SETSIG, libc::SIGURG)
            .and_then(|_| ask(libc::F_SETLEASE, libc::F_WRLCK))
            .is_ok();
        if granted {
            let _ = ask(libc::F_SETLEASE, libc::F_UNLCK);
        }
        granted
    }

    /// Maps the first `len` bytes. `populate` fills the page tables at once.
    pub(crate) fn map(&self, len: u64, access: Access, populate: bool) -> io::Result<Mapping> {
        let len = usize::try_from(len).map_err(|_| io::Error::from_raw_os_error(libc::EFBIG))?;
        let protection = match access {
            Access::Read => libc::PROT_READ,
            Access::Write => libc::PROT_READ | libc::PROT_WRITE,
        };
        let flags = libc::MAP_SHARED | if populate { libc::MAP_POPULATE } else { 0 };
        // SAFETY: a new mapping at an address of the kernel's choice touches no memory in use.
        let base = unsafe { libc::mmap(ptr::null_mut(), len, protection, flags, self.fd(), 0) };
        if base == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        Ok(Mapping {
            base: base.cast(),
            len,
        })
    }

    fn fd(&self) -> RawFd {
        self.file.as_raw_fd()
    }
}

/// Linux's number, which libc does not name.
const F_SETSIG: i32 = 10;

/// OFD locks always take 64-bit offsets; glibc's plain `flock` has 32-bit ones on 32-bit machines.
#[cfg(all(target_env = "gnu", target_pointer_width = "32"))]
type Flock = libc::flock64;
#[cfg(not(all(target_env = "gnu", target_pointer_width = "32")))]
type Flock = libc::flock;

fn lock_of(byte: u64, kind: i32) -> Flock {
    // SAFETY: all-zero bytes are a valid flock: integers only.
    let mut lock: Flock = unsafe { std::mem::zeroed() };
    lock.l_type = kind as _;
    lock.l_whence = libc::SEEK_SET as _;
    lock.l_start = byte as _;
    lock.l_len = 1;
    lock
}

/// A shared mapping of a segment.
#[derive(Debug)]
pub(crate) struct Mapping {
    base: *mut u8,
    len: usize,
}

// SAFETY: a Mapping is only an address and a length; whoever reads or writes there uses atomics.
unsafe impl Send for Mapping {}
// SAFETY: as above.
unsafe impl Sync for Mapping {}

impl Mapping {
    #[inline]
    pub(crate) fn base(&self) -> *mut u8 {
        self.base
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }
}

impl Mapping {
    /// Keeps `len` bytes at `at` and lets all else of the mapping go: the pages under them are replaced by private ones with
    /// the same content, at the same address, in one step as others see it. Tells where in what is left the bytes are.
    pub(crate) fn make_private(&mut self, at: usize, len: usize) -> io::Result<usize> {
        let page = page_size();
        let from = at / page * page;
        let to = (at + len.max(1)).div_ceil(page) * page;
        let end = self.len.div_ceil(page) * page;
        let mut copy = Mapping::private(to - from)?;
        // SAFETY: the mapping has `len` bytes at `at`, and the copy, new and of this function's own, has room for them there.
        unsafe {
            crate::copy::out_of_shared(
                self.base.wrapping_add(at),
                copy.base.wrapping_add(at - from),
                len,
            );
        }
        copy.move_onto(self.base.wrapping_add(from))?;
        // From here on the copy's address range is the middle of the old one.
        let old = std::mem::replace(self, copy);
        unmap(old.base, from);
        unmap(old.base.wrapping_add(to), end - to);
        std::mem::forget(old);
        Ok(at - from)
    }

    fn private(len: usize) -> io::Result<Mapping> {
        let protection = libc::PROT_READ | libc::PROT_WRITE;
        let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_POPULATE;
        // SAFETY: a new mapping at an address of the kernel's choice touches no memory in use.
        let base = unsafe { libc::mmap(ptr::null_mut(), len, protection, flags, -1, 0) };
        if base == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        Ok(Mapping {
            base: base.cast(),
            len,
        })
    }

    /// Moves to another address, whose mapping it replaces there.
    fn move_onto(&mut self, target: *mut u8) -> io::Result<()> {
        let flags = libc::MREMAP_MAYMOVE | libc::MREMAP_FIXED;
        let (from, len) = (self.base.cast(), self.len);
        // SAFETY: the target range belongs to a mapping of the caller's, whose readers find the same bytes there.
        let moved = unsafe { libc::mremap(from, len, len, flags, target.cast::<libc::c_void>()) };
        if moved == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        self.base = moved.cast();
        Ok(())
    }
}

fn unmap(base: *mut u8, len: usize) {
    if len > 0 {
        // SAFETY: called for parts of a mapping that its owner lets go.
        unsafe { libc::munmap(base.cast(), len) };
    }
}

fn page_size() -> usize {
    // SAFETY: sysconf takes no pointer.
    let size = unsafe { libc::sysconf(libc::_SC_PAGESIZE) };
    usize::try_from(size).unwrap_or(4096)
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: base and len are those of a mapping made by Segment::map, unmapped only here.
        unsafe { libc::munmap(self.base.cast(), self.len) };
    }
}

/// The kernel's `struct timespec` of the futex call, whose fields are as wide as a register whatever libc's are.
#[repr(C)]
struct KernelTimespec {
    seconds: libc::c_long,
    nanoseconds: libc::c_long,
}

fn kernel_timespec(timeout: Duration) -> KernelTimespec {
    KernelTimespec {
        seconds: timeout.as_secs().try_into().unwrap_or(libc::c_long::MAX),
        nanoseconds: timeout.subsec_nanos() as libc::c_long,
    }
}

pub(crate) fn futex_wait(word: &AtomicU32, expected: u32, timeout: Duration) {
    let timeout = kernel_timespec(timeout);
    // SAFETY: the word and the timeout outlive the call. Every result is a reason to look again.
    unsafe {
        libc::syscall(
            libc::SYS_futex,
            word.as_ptr(),
            libc::FUTEX_WAIT,
            expected,
            ptr::from_ref(&timeout),
        )
    };
}

pub(crate) fn futex_wake_all(word: &AtomicU32) -> u32 {
    // SAFETY: the word outlives the call.
    let woken =
        unsafe { libc::syscall(libc::SYS_futex, word.as_ptr(), libc::FUTEX_WAKE, i32::MAX) };
    u32::try_from(woken).unwrap_or(0)
}

/// Words of a mapping that only the kernel touches: EFAULT where the file has become shorter, and no signal.
impl Mapping {
    /// Sleeps while the word at `offset` is `expected`, at most for `timeout`. Returns for no reason, too.
    pub(crate) fn futex_wait(
        &self,
        offset: usize,
        expected: u32,
        timeout: Duration,
    ) -> io::Result<()> {
        let timeout = kernel_timespec(timeout);
        // SAFETY: the kernel checks the address, and the timeout outlives the call.
        let result = unsafe {
            libc::syscall(
                libc::SYS_futex,
                self.base.wrapping_add(offset),
                libc::FUTEX_WAIT,
                expected,
                ptr::from_ref(&timeout),
            )
        };
        match io::Error::last_os_error() {
            error if result < 0 && error.raw_os_error() == Some(libc::EFAULT) => Err(error),
            _ => Ok(()),
        }
    }

    pub(crate) fn set_bit(&self, offset: usize, bit: u32) -> io::Result<()> {
        self.wake_op(offset, 1, FUTEX_OP_OR | FUTEX_OP_SHIFT, bit)
    }

    pub(crate) fn clear_bit(&self, offset: usize, bit: u32) -> io::Result<()> {
        self.wake_op(offset, 1, FUTEX_OP_ANDN | FUTEX_OP_SHIFT, bit)
    }

    /// Adds 1 to the word at `offset` and wakes all that sleep on it.
    pub(crate) fn bump_and_wake(&self, offset: usize) -> io::Result<()> {
        self.wake_op(offset, i32::MAX, FUTEX_OP_ADD, 1)
    }

    /// `operand` is shifted below the sign bit of its 12 bits: at most 15 and 1 here.
    fn wake_op(&self, offset: usize, wake: i32, op: u32, operand: u32) -> io::Result<()> {
        let word = self.base.wrapping_add(offset);
        let nobody_else: usize = 0;
        let change = op << 28 | operand << 12;
        // SAFETY: the kernel checks the address. It changes the word at once, as an atomic instruction does.
        let result = unsafe {
            libc::syscall(
                libc::SYS_futex,
                word,
                libc::FUTEX_WAKE_OP,
                wake,
                nobody_else,
                word,
                change,
            )
        };
        if result < 0 {
            Err(io::Error::last_os_error())
        } else {
            Ok(())
        }
    }
}

/// The kernel's numbers, in the highest four bits of FUTEX_WAKE_OP's last argument.
const FUTEX_OP_ADD: u32 = 1;
const FUTEX_OP_OR: u32 = 2;
const FUTEX_OP_ANDN: u32 = 3;
/// The operand is the number of a bit.
const FUTEX_OP_SHIFT: u32 = 8;

/// Tells when a file appears in a directory.
#[derive(Debug)]
pub(crate) struct Watch {
    fd: OwnedFd,
}

impl Watch {
    pub(crate) fn new(dir: &Path) -> io::Result<Watch> {
        // SAFETY: inotify_init1 takes no pointer.
        let fd = check(unsafe { libc::inotify_init1(libc::IN_CLOEXEC | libc::IN_NONBLOCK) })?;
        let watch = Watch { fd: own(fd) };
        let dir = CString::new(dir.as_os_str().as_bytes())?;
        let events = libc::IN_CREATE | libc::IN_MOVED_TO;
        // SAFETY: the path is NUL-terminated and outlives the call.
        check(unsafe { libc::inotify_add_watch(fd, dir.as_ptr(), events) })?;
        Ok(watch)
    }
}

/// A private flag that a sleeping thread can be woken by.
#[derive(Debug)]
pub(crate) struct Event {
    fd: OwnedFd,
}

impl Event {
    pub(crate) fn new() -> io::Result<Event> {
        // SAFETY: eventfd takes no pointer.
        let fd = check(unsafe { libc::eventfd(0, libc::EFD_CLOEXEC | libc::EFD_NONBLOCK) })?;
        Ok(Event { fd: own(fd) })
    }

    pub(crate) fn raise(&self) {
        let one = 1_u64.to_ne_bytes();
        // SAFETY: eight bytes are readable. The only failure, a full counter, leaves the event raised.
        unsafe { libc::write(self.fd.as_raw_fd(), one.as_ptr().cast(), one.len()) };
    }

    pub(crate) fn clear(&self) {
        drain(&self.fd);
    }
}

/// Sleeps until the event is raised, a file appears in the watched directory or the time is up, and clears both.
pub(crate) fn wait_for_either(event: &Event, watch: Option<&Watch>, timeout: Duration) {
    let slot = |fd: RawFd| libc::pollfd {
        fd,
        events: libc::POLLIN,
        revents: 0,
    };
    // A negative descriptor is ignored by poll.
    let mut polled = [
        slot(event.fd.as_raw_fd()),
        slot(watch.map_or(-1, |watch| watch.fd.as_raw_fd())),
    ];
    let timeout_ms = i32::try_from(timeout.as_micros().div_ceil(1000)).unwrap_or(i32::MAX);
    // SAFETY: two pollfds are exclusively borrowed.
    unsafe {
        libc::poll(
            polled.as_mut_ptr(),
            polled.len() as libc::nfds_t,
            timeout_ms,
        )
    };
    drain(&event.fd);
    if let Some(watch) = watch {
        drain(&watch.fd);
    }
}

fn drain(fd: &OwnedFd) {
    let mut buffer = [0_u64; 512];
    let room = size_of_val(&buffer);
    loop {
        // SAFETY: `room` bytes are writable. The descriptor does not block.
        let got = unsafe { libc::read(fd.as_raw_fd(), buffer.as_mut_ptr().cast(), room) };
        if got < room as isize {
            return;
        }
    }
}

#[inline]
pub(crate) fn monotonic_raw_ns() -> u64 {
    clock_ns(libc::CLOCK_MONOTONIC_RAW)
}

pub(crate) fn realtime_ns() -> i64 {
    clock_ns(libc::CLOCK_REALTIME) as i64
}

#[inline]
fn clock_ns(id: libc::clockid_t) -> u64 {
    // SAFETY: all-zero bytes are a valid timespec, whose padding differs from C library to C library.
    let mut now: libc::timespec = unsafe { std::mem::zeroed() };
    // SAFETY: the timespec is exclusively borrowed; both clocks exist on every Linux that has OFD locks.
    unsafe { libc::clock_gettime(id, &mut now) };
    (now.tv_sec as u64)
        .wrapping_mul(1_000_000_000)
        .wrapping_add(now.tv_nsec as u64)
}

/// A random number other than 0.
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

/// Has `call` run in each child that this process forks from now on.
pub(crate) fn call_in_children(call: extern "C" fn()) {
    // SAFETY: the function lives for ever, and does nothing that a child with one thread may not.
    // It fails only without memory; then children are taken for their parents, as they were.
    let _ = unsafe { libc::pthread_atfork(None, None, Some(call)) };
}

/// Starts a thread that gets no signals, so that they go to threads of the program, which may wait for them.
pub(crate) fn start_thread(
    name: &str,
    stack_bytes: usize,
    run: impl FnOnce() + Send + 'static,
) -> io::Result<std::thread::JoinHandle<()>> {
    let thread = std::thread::Builder::new().name(name.into());
    // SAFETY: all-zero bytes are a valid set of signals, and sigfillset fills it.
    let [mut all, mut own]: [libc::sigset_t; 2] = unsafe { std::mem::zeroed() };
    // SAFETY: the set is exclusively borrowed.
    unsafe { libc::sigfillset(&mut all) };
    // SAFETY: one set is borrowed, one exclusively. A thread begins with the signals of the one that starts it.
    unsafe { libc::pthread_sigmask(libc::SIG_SETMASK, &all, &mut own) };
    let started = thread.stack_size(stack_bytes).spawn(run);
    // SAFETY: the set is the one that was there before.
    unsafe { libc::pthread_sigmask(libc::SIG_SETMASK, &own, ptr::null_mut()) };
    started
}

/// Whether the calling thread would get a signal that asks the program to end.
#[cfg(test)]
pub(crate) fn gets_signals() -> bool {
    // SAFETY: all-zero bytes are a valid set of signals.
    let mut blocked: libc::sigset_t = unsafe { std::mem::zeroed() };
    // SAFETY: the set is exclusively borrowed; without a new one nothing changes.
    unsafe { libc::pthread_sigmask(libc::SIG_SETMASK, ptr::null(), &mut blocked) };
    // SAFETY: the set is borrowed.
    unsafe { libc::sigismember(&blocked, libc::SIGTERM) == 0 }
}

/// When this process started, in clock ticks since boot; 0 if /proc does not tell.
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

fn own(fd: RawFd) -> OwnedFd {
    // SAFETY: called right after the system call that made the descriptor, which nobody else owns.
    unsafe { OwnedFd::from_raw_fd(fd) }
}

/// Whether the kernel found no page behind a mapping: the file has become shorter.
pub(crate) fn is_missing_page(error: &io::Error) -> bool {
    error.raw_os_error() == Some(libc::EFAULT)
}

fn check(result: i32) -> io::Result<i32> {
    if result < 0 {
        Err(io::Error::last_os_error())
    } else {
        Ok(result)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
    use std::thread;

    #[test]
    fn asking_whether_a_file_is_unused_survives_that_it_is_opened_just_then() {
        let path = std::env::temp_dir().join(format!("conduit_lease_{}", std::process::id()));
        let segment = Segment {
            file: File::create(&path).unwrap(),
        };
        let refused = AtomicBool::new(false);
        thread::scope(|scope| {
            scope.spawn(|| {
                while Segment::open(&path, Access::Write).is_ok() {}
                refused.store(true, Relaxed);
            });
            while !refused.load(Relaxed) {
                segment.is_unused();
            }
        });
        std::fs::remove_file(&path).unwrap();
        assert!(segment.is_unused());
    }
}
