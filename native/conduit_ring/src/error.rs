//! The errors of opening, reading and waiting. [`PublishError`](crate::PublishError) is apart:
//! publishing is the fast path, and its error is small and owns nothing.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Linux's numbers.
const EPERM: i32 = 1;
const EINVAL: i32 = 22;

/// Why a ring could not be opened, read or awaited.
///
/// Each error that concerns a file names it, and [`Error::Os`] keeps the operating system's own
/// error. The texts are sentences for people: which file, what is wrong, and where possible what
/// to do.
///
/// ```
/// use conduit_ring::{Error, Publisher, PublisherOptions, Topic};
///
/// # let name = format!("doc-second-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// let error = Publisher::open(&topic, &PublisherOptions::default()).unwrap_err();
/// assert!(matches!(error, Error::PublisherAlive { pid, .. } if pid == std::process::id()));
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// The topic's name is not `[A-Za-z0-9_.-]{1,200}`.
    InvalidTopic {
        /// The name that was given.
        name: String,
    },
    /// Number or length of the slots is outside the limits.
    InvalidGeometry {
        /// What was expected and what was given.
        reason: String,
    },
    /// Another publisher of this topic lives.
    ///
    /// End it, or publish under another name: a topic has one publisher at a time.
    PublisherAlive {
        /// The segment's file.
        path: PathBuf,
        /// The process of the other publisher, as it wrote it there; 0 until it has.
        pid: u32,
    },
    /// A publisher without the extension made the file, and some process may still use it.
    ///
    /// End that process, or set [`PublisherOptions::force`](crate::PublisherOptions::force).
    LegacyInUse {
        /// The segment's file.
        path: PathBuf,
    },
    /// The file belongs to a user who is not trusted.
    ///
    /// Remove the file, publish as that user, or list the user as [`trust`](crate::trust)
    /// describes.
    ForeignOwner {
        /// The segment's file.
        path: PathBuf,
        /// The number of the file's owner.
        user: u32,
        /// The owner's name, if this machine knows one.
        name: Option<String>,
    },
    /// A list of trusted users or groups has an entry that is neither a number nor a known name.
    InvalidTrust {
        /// What was expected and what was given.
        reason: String,
    },
    /// All 16 reader slots are taken, by readers that live.
    ///
    /// Close a subscriber, or use an [`Observer`](crate::Observer), which takes no slot.
    NoReaderSlot {
        /// The segment's file.
        path: PathBuf,
    },
    /// The subscriber has three leases already.
    ///
    /// Drop one, or [`detach`](crate::Lease::detach) it.
    TooManyLeases {
        /// The segment's file.
        path: PathBuf,
    },
    /// The publisher or subscriber belongs to the process that forked this one.
    ///
    /// Open the topic in this process, or call `exec` behind `fork`.
    Forked {
        /// The segment's file.
        path: PathBuf,
    },
    /// The topic does not exist. Only functions that inspect or repair a topic return it: a
    /// subscriber waits for the topic.
    NoTopic {
        /// The file that does not exist.
        path: PathBuf,
    },
    /// The file is not a segment that this version can use.
    ///
    /// A publisher replaces such a file when no process uses it.
    BadSegment {
        /// The segment's file.
        path: PathBuf,
        /// What is wrong with the file.
        fault: Fault,
    },
    /// The operating system refused.
    ///
    /// A full `/dev/shm` is the usual case: its pages are allocated when a topic is made.
    Os {
        /// The operation that failed, such as `"open"` or `"map"`.
        action: &'static str,
        /// The file that it was for.
        path: PathBuf,
        /// The operating system's error, with its errno.
        source: io::Error,
    },
}

impl Error {
    /// Returns the errno behind this error.
    ///
    /// It is the operating system's own for [`Error::Os`]. For [`Error::ForeignOwner`] and
    /// [`Error::InvalidTrust`] it is the errno that the operating system would have given. The
    /// other errors have none.
    pub fn errno(&self) -> Option<i32> {
        match self {
            Error::Os { source, .. } => source.raw_os_error(),
            Error::ForeignOwner { .. } => Some(EPERM),
            Error::InvalidTrust { .. } => Some(EINVAL),
            _ => None,
        }
    }

    pub(crate) fn os(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Error {
        let path = path.to_owned();
        move |source| Error::Os {
            action,
            path,
            source,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::InvalidTopic { name } => {
                write!(
                    f,
                    "expected a topic name, 1 to 200 of A-Z a-z 0-9 _ . -, got: {name:?}"
                )
            }
            Error::InvalidGeometry { reason } => f.write_str(reason),
            Error::PublisherAlive { path, pid } => {
                write!(f, "{}: process {pid} publishes this topic", path.display())
            }
            Error::LegacyInUse { path } => write!(
                f,
                "{}: made by a publisher without the extension, and a process may still use it; \
                 end that process, or publish with force",
                path.display()
            ),
            Error::ForeignOwner { path, user, name } => {
                write!(f, "{} belongs to user {user}", path.display())?;
                if let Some(name) = name {
                    write!(f, " ({name})")?;
                }
                write!(
                    f,
                    ", who is not trusted here: remove the file, publish as that user, or list \
                     the user in CONDUIT_RING_TRUSTED_UIDS"
                )
            }
            Error::InvalidTrust { reason } => f.write_str(reason),
            Error::NoReaderSlot { path } => {
                write!(f, "{}: all 16 reader slots are taken", path.display())
            }
            Error::TooManyLeases { path } => {
                write!(
                    f,
                    "{}: this subscriber has 3 leases already",
                    path.display()
                )
            }
            Error::Forked { path } => write!(
                f,
                "{}: opened by the process that forked this one; open the topic in this process",
                path.display()
            ),
            Error::NoTopic { path } => write!(f, "{}: there is no such topic", path.display()),
            Error::BadSegment { path, fault } => write!(f, "{}: {fault}", path.display()),
            Error::Os {
                action,
                path,
                source,
            } => write!(
                f,
                "{}: {action}: {}",
                path.display(),
                reason_of(path, source)
            ),
        }
    }
}

/// Returns the operating system's reason for people, without the errno.
fn reason_of(path: &Path, source: &io::Error) -> String {
    let text = source.to_string();
    if source.kind() == io::ErrorKind::StorageFull {
        let directory = path.parent().unwrap_or(path).display();
        return format!(
            "no space left in {directory}; remove topics that are not in use, or mount it with a \
             larger size"
        );
    }
    match text.split_once(" (os error ") {
        Some((reason, _)) => reason.to_lowercase(),
        None => text,
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Os { source, .. } => Some(source),
            _ => None,
        }
    }
}

/// What is wrong with a file that has a topic's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Fault {
    /// The name leads to a directory, a device or the like.
    NotAFile,
    /// The file is shorter than a header, or all zeros. A publisher without the extension may be
    /// initialising it at this moment.
    NotReady,
    /// Slot count or slot size is outside the limits.
    Geometry,
    /// `max_subscribers` is not 16.
    MaxSubscribers,
    /// The file is shorter than its geometry says.
    Truncated,
    /// The version of the extension is unknown to this version of the crate.
    Version,
    /// The checksum of geometry and content tag is wrong.
    Checksum,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Fault::NotAFile => "not a regular file",
            Fault::NotReady => "not initialised",
            Fault::Geometry => "slot count or slot size is outside the limits",
            Fault::MaxSubscribers => "max_subscribers is not 16",
            Fault::Truncated => "shorter than its slots",
            Fault::Version => "the version of the extension is unknown",
            Fault::Checksum => "the checksum of its geometry is wrong",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sentence(errno: i32) -> String {
        let path = Path::new("/dev/shm/conduit_x");
        Error::os("create", path)(io::Error::from_raw_os_error(errno)).to_string()
    }

    #[test]
    fn the_answers_of_the_operating_system_are_words() {
        assert_eq!(
            sentence(13),
            "/dev/shm/conduit_x: create: permission denied"
        );
        let full = sentence(28);
        assert!(
            full.starts_with("/dev/shm/conduit_x: create: no space left in /dev/shm; "),
            "{full}"
        );
    }
}
