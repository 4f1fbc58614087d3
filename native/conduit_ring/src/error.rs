//! What can go wrong.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Linux's numbers.
const EPERM: i32 = 1;
const EINVAL: i32 = 22;

/// Why a ring could not be opened, read or awaited.
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
        /// What was given and what is accepted.
        reason: String,
    },
    /// Another publisher of this topic lives.
    PublisherAlive {
        /// The segment's file.
        path: PathBuf,
        /// Its process, as it wrote it there; 0 when it has not yet.
        pid: u32,
    },
    /// The file was made by a publisher without the extension, and some process may still use it.
    LegacyInUse {
        /// The segment's file.
        path: PathBuf,
    },
    /// The file belongs to a user who is not trusted: see [`trust`](crate::trust).
    ForeignOwner {
        /// The segment's file.
        path: PathBuf,
        /// Its owner.
        user: u32,
        /// The owner's name, if this machine knows one.
        name: Option<String>,
    },
    /// A list of trusted users or groups has an entry that is none.
    InvalidTrust {
        /// What was given and what is accepted.
        reason: String,
    },
    /// All 16 reader slots are taken.
    NoReaderSlot {
        /// The segment's file.
        path: PathBuf,
    },
    /// The subscriber has as many leases as it may have.
    TooManyLeases {
        /// The segment's file.
        path: PathBuf,
    },
    /// It was opened by the process that forked this one.
    Forked {
        /// The segment's file.
        path: PathBuf,
    },
    /// There is no such topic.
    NoTopic {
        /// The file that is not there.
        path: PathBuf,
    },
    /// The file is not a segment that this version can use.
    BadSegment {
        /// The segment's file.
        path: PathBuf,
        /// What is wrong with it.
        fault: Fault,
    },
    /// The operating system refused.
    Os {
        /// What was tried.
        action: &'static str,
        /// On which file.
        path: PathBuf,
        /// Its answer, with the errno.
        source: io::Error,
    },
}

impl Error {
    /// The errno behind this error, if the operating system gave one, or would have for what is refused here.
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
                    "{name:?} is no topic name; accepted are 1 to 200 of A-Z a-z 0-9 _ . -"
                )
            }
            Error::InvalidGeometry { reason } => f.write_str(reason),
            Error::PublisherAlive { path, pid } => {
                write!(f, "{}: process {pid} publishes this topic", path.display())
            }
            Error::LegacyInUse { path } => write!(
                f,
                "{}: made by a publisher without the extension, and a process may still use it",
                path.display()
            ),
            Error::ForeignOwner { path, user, name } => {
                write!(f, "{} belongs to user {user}", path.display())?;
                if let Some(name) = name {
                    write!(f, " ({name})")?;
                }
                write!(
                    f,
                    ", who is not trusted here: remove the file, publish as that user, or list the user in \
                     CONDUIT_RING_TRUSTED_UIDS"
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
            } => write!(f, "{}: {action}: {}", path.display(), words(path, source)),
        }
    }
}

/// The answer of the operating system as a person wants to read it.
fn words(path: &Path, source: &io::Error) -> String {
    let text = source.to_string();
    if source.kind() == io::ErrorKind::StorageFull {
        let directory = path.parent().unwrap_or(path).display();
        return format!(
            "no space left in {directory}; remove topics that nobody uses, or mount it with a larger size"
        );
    }
    match text.split_once(" (os error ") {
        Some((words, _)) => words.to_lowercase(),
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

/// What is wrong with a file that should be a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Fault {
    /// It is a directory, a device or the like.
    NotAFile,
    /// It is shorter than a header, or all zeros: a publisher without the extension may be making it right now.
    NotReady,
    /// Slot count or slot size is outside the limits.
    Geometry,
    /// `max_subscribers` is not 16.
    MaxSubscribers,
    /// The file is shorter than its geometry says.
    Truncated,
    /// It has the extension in a version that is unknown here.
    Version,
    /// Geometry and content tag do not have the checksum that stands beside them.
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
            Fault::Version => "an unknown version of the extension",
            Fault::Checksum => "the checksum of its geometry is wrong",
        })
    }
}

/// Why a message was not published.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PublishError {
    /// It does not fit into a slot. It is counted, and nothing was written.
    TooLarge {
        /// Its length in bytes.
        len: usize,
        /// The longest that fits.
        max: usize,
    },
    /// Subscribers' [`Lease`](crate::Lease)s hold messages in all slots. It was dropped and counted; the next one gets the same
    /// number.
    SlotHeld,
    /// The publisher belongs to the process that forked this one.
    Forked,
    /// The topic's name does not lead to this publisher's file any more, and that could not be made anew: see
    /// [`Publisher::trouble`](crate::Publisher::trouble). Nothing was published; it is tried again.
    NameLost,
}

impl fmt::Display for PublishError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PublishError::TooLarge { len, max } => {
                write!(f, "the message has {len} bytes and a slot holds {max}")
            }
            PublishError::SlotHeld => f.write_str("subscribers hold all slots"),
            PublishError::Forked => {
                f.write_str("the publisher belongs to the process that forked this one")
            }
            PublishError::NameLost => {
                f.write_str("the topic's file was removed and could not be made anew")
            }
        }
    }
}

impl std::error::Error for PublishError {}

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
