//! An open segment file, and the names that lead to it.

use std::ffi::OsString;
use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io;
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt, PermissionsExt, fchown};
use std::path::Path;

use nix::fcntl::{AT_FDCWD, AtFlags, posix_fallocate};
use nix::unistd::linkat;

/// An open segment file. Locks belong to it, not to the process.
#[derive(Debug)]
pub(crate) struct Segment {
    file: File,
}

/// How a segment is opened and mapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    Read,
    Write,
}

/// The file that a path leads to, seen from an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Name {
    /// The path leads to this file.
    Same,
    /// The path leads to another file.
    Other,
    /// The path leads nowhere.
    Missing,
}

/// The user and the group that own a file.
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

/// The identity of a file, as `/proc/PID/maps` shows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FileId {
    /// Major and minor number.
    pub(crate) device: (u32, u32),
    pub(crate) inode: u64,
}

impl FileId {
    pub(crate) fn of(found: &Metadata) -> FileId {
        FileId {
            device: (libc::major(found.dev()), libc::minor(found.dev())),
            inode: found.ino(),
        }
    }
}

/// Returns the names in a directory.
pub(crate) fn names_in(directory: &Path) -> io::Result<Vec<OsString>> {
    std::fs::read_dir(directory)?
        .map(|entry| Ok(entry?.file_name()))
        .collect()
}

/// Returns the owner of the file at a path; for a symbolic link, the link's own.
pub(crate) fn owner_of(path: &Path) -> io::Result<FileOwner> {
    std::fs::symlink_metadata(path).map(|found| FileOwner::of(&found))
}

/// Returns whether new files get the group of this directory instead of their maker's.
pub(crate) fn gives_group(directory: &Path) -> bool {
    const SET_GROUP: u32 = 0o2000;
    std::fs::metadata(directory).map_or(true, |found| found.mode() & SET_GROUP != 0)
}

/// Returns a small file as text. A file that does not exist is empty.
pub(crate) fn text_of(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

impl Segment {
    /// Opens a file that exists. Symbolic links are not followed.
    pub(crate) fn open(path: &Path, access: Access) -> io::Result<Segment> {
        let file = OpenOptions::new()
            .read(true)
            .write(access == Access::Write)
            .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK | libc::O_CLOEXEC)
            .open(path)?;
        Ok(Segment { file })
    }

    /// Makes a new file without a name: zeroed, with all of its pages allocated.
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

    pub(super) fn from_file(file: File) -> Segment {
        Segment { file }
    }

    pub(super) fn file(&self) -> &File {
        &self.file
    }

    pub(super) fn fd(&self) -> RawFd {
        self.file.as_raw_fd()
    }

    /// Allocates every page of the first `len` bytes, so that a full file system is an error now
    /// and not a signal later.
    pub(crate) fn allocate(&self, len: u64) -> io::Result<()> {
        let len = len
            .try_into()
            .map_err(|_| io::Error::from_raw_os_error(libc::EFBIG))?;
        Ok(posix_fallocate(&self.file, 0, len)?)
    }

    /// Gives a name to a file made by [`Segment::create`]. Returns `AlreadyExists` when the name
    /// is taken.
    pub(crate) fn link(&self, path: &Path) -> io::Result<()> {
        let own = format!("/proc/self/fd/{}", self.fd());
        let follow = AtFlags::AT_SYMLINK_FOLLOW;
        Ok(linkat(AT_FDCWD, own.as_str(), AT_FDCWD, path, follow)?)
    }

    pub(crate) fn is_regular(&self) -> io::Result<bool> {
        Ok(self.file.metadata()?.is_file())
    }

    pub(crate) fn len(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    /// Returns the first `N` bytes, or `None` when the file is shorter.
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

    /// Fills `len` bytes at `to` from the file at `offset`. Returns `UnexpectedEof` where the
    /// file ends before.
    ///
    /// # Safety
    /// `to` is valid for writes of `len` bytes. They need not be initialised.
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

    /// Returns permissions and group.
    pub(crate) fn access_rights(&self) -> io::Result<(u32, u32)> {
        self.file
            .metadata()
            .map(|found| (found.mode() & 0o7777, found.gid()))
    }

    /// Returns whether this and the other one are the same file.
    pub(crate) fn is_same(&self, other: &Segment) -> io::Result<bool> {
        Ok(self.id()? == other.id()?)
    }

    /// Copies the bytes from `from` to `to` of the other file to the same place in this one.
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

    /// Writes the first bytes of the file.
    pub(crate) fn write_head(&self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all_at(bytes, 0)
    }

    /// Returns whether `path` still leads to this file.
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
}
