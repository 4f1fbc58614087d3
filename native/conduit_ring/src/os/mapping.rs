//! A segment file in memory.

use std::io;
use std::mem::{self, ManuallyDrop};
use std::os::fd::RawFd;
use std::ptr;

use nix::unistd::{SysconfVar, sysconf};

use super::file::{Access, Segment};
use crate::copy;

/// A shared mapping of a segment, or the private pages that a detached lease keeps of one.
///
/// A mapping is an address and a length. `Memory` puts the segment's fields on top of it.
#[derive(Debug)]
pub(crate) struct Mapping {
    base: *mut u8,
    len: usize,
}

// SAFETY: a Mapping is only an address and a length; all accesses through it are atomic.
unsafe impl Send for Mapping {}
// SAFETY: as above.
unsafe impl Sync for Mapping {}

impl Segment {
    /// Maps the first `len` bytes. `populate` fills the page tables at once.
    pub(crate) fn map(&self, len: u64, access: Access, populate: bool) -> io::Result<Mapping> {
        let len = usize::try_from(len).map_err(|_| io::Error::from_raw_os_error(libc::EFBIG))?;
        let protection = match access {
            Access::Read => libc::PROT_READ,
            Access::Write => libc::PROT_READ | libc::PROT_WRITE,
        };
        let populate = if populate { libc::MAP_POPULATE } else { 0 };
        Mapping::new(len, protection, libc::MAP_SHARED | populate, self.fd())
    }
}

impl Mapping {
    fn new(len: usize, protection: i32, flags: i32, fd: RawFd) -> io::Result<Mapping> {
        // SAFETY: a new mapping at an address of the kernel's choice touches no memory in use.
        let base = unsafe { libc::mmap(ptr::null_mut(), len, protection, flags, fd, 0) };
        if base == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        Ok(Mapping {
            base: base.cast(),
            len,
        })
    }

    /// Maps private pages that belong to no file.
    fn private(len: usize) -> io::Result<Mapping> {
        let protection = libc::PROT_READ | libc::PROT_WRITE;
        let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_POPULATE;
        Mapping::new(len, protection, flags, -1)
    }

    /// Returns the address of the first byte. It is aligned to a page.
    #[inline]
    pub(crate) fn base(&self) -> *mut u8 {
        self.base
    }

    /// Returns the length in bytes.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Keeps `len` bytes at `at` and unmaps the rest, without moving the bytes.
    ///
    /// The pages under the bytes are replaced by private ones with the same content, at the same
    /// address, in one step as other threads see it. Returns where the bytes begin in what is
    /// left of the mapping.
    pub(crate) fn make_private(&mut self, at: usize, len: usize) -> io::Result<usize> {
        let page = page_size();
        let from = at / page * page;
        let to = (at + len.max(1)).div_ceil(page) * page;
        let end = self.len.div_ceil(page) * page;
        let mut copy = Mapping::private(to - from)?;
        let (source, target) = (
            self.base.wrapping_add(at),
            copy.base.wrapping_add(at - from),
        );
        // SAFETY: the mapping has `len` bytes at `at`, and the copy, new and of this function's
        // own, has room for them there.
        unsafe { copy::out_of_shared(source, target, len) };
        copy.move_onto(self.base.wrapping_add(from))?;
        // From here on the copy owns the middle of the old address range. What lies before and
        // behind it is unmapped, each part by its own value.
        let old = ManuallyDrop::new(mem::replace(self, copy));
        drop(Mapping {
            base: old.base,
            len: from,
        });
        drop(Mapping {
            base: old.base.wrapping_add(to),
            len: end - to,
        });
        Ok(at - from)
    }

    /// Moves the mapping to another address and replaces the mapping that is there.
    fn move_onto(&mut self, target: *mut u8) -> io::Result<()> {
        let flags = libc::MREMAP_MAYMOVE | libc::MREMAP_FIXED;
        let (from, len) = (self.base.cast(), self.len);
        // SAFETY: the target range belongs to a mapping of the caller's, whose readers find the
        // same bytes there.
        let moved = unsafe { libc::mremap(from, len, len, flags, target.cast::<libc::c_void>()) };
        if moved == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        self.base = moved.cast();
        Ok(())
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        if self.len > 0 {
            // SAFETY: this value alone owns the address range, and no reference into it is left.
            unsafe { libc::munmap(self.base.cast(), self.len) };
        }
    }
}

fn page_size() -> usize {
    let size = sysconf(SysconfVar::PAGE_SIZE).ok().flatten();
    size.and_then(|size| usize::try_from(size).ok())
        .unwrap_or(4096)
}
