//! The name of a topic, and the file that it stands for.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::error::Error;

/// The directory of segments, unless the environment names another one.
const SHARED_MEMORY: &str = "/dev/shm";
/// The variable that names another directory. Topics there are separate from those of the rest of
/// the machine.
const DIRECTORY_VARIABLE: &str = "CONDUIT_RING_DIR";
/// The start of a segment's file name.
pub(crate) const PREFIX: &str = "conduit_";
const MAX_LEN: usize = 200;
/// The longest name behind the prefix that a file can have, in bytes.
const MAX_FOUND_LEN: usize = 255 - PREFIX.len();

/// Returns the directory of this process's segments.
pub(crate) fn directory() -> &'static Path {
    static DIRECTORY: OnceLock<PathBuf> = OnceLock::new();
    DIRECTORY.get_or_init(|| named(std::env::var_os(DIRECTORY_VARIABLE)))
}

fn named(directory: Option<OsString>) -> PathBuf {
    match directory {
        Some(path) if !path.is_empty() => path.into(),
        _ => SHARED_MEMORY.into(),
    }
}

/// A checked topic name, which can name nothing but a segment.
///
/// [`Topic::new`] accepts `[A-Za-z0-9_.-]{1,200}`: these are the names that a
/// [`Publisher`](crate::Publisher) may make. [`Topic::found`] accepts whatever name a publisher
/// with other rules has used.
///
/// The file lies in `/dev/shm`, or in the directory that the variable `CONDUIT_RING_DIR` of the
/// environment names.
///
/// ```
/// let topic = conduit_ring::Topic::new("imu")?;
/// assert_eq!(topic.path().to_str(), Some("/dev/shm/conduit_imu"));
/// assert!(conduit_ring::Topic::new("../etc/passwd").is_err());
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Topic {
    path: PathBuf,
    name: String,
}

impl Topic {
    /// Checks a name.
    ///
    /// # Errors
    /// [`Error::InvalidTopic`], whose text says what is accepted and what was given.
    pub fn new(name: &str) -> Result<Topic, Error> {
        let accepted = (1..=MAX_LEN).contains(&name.len()) && name.bytes().all(is_allowed);
        if !accepted {
            return Err(Error::InvalidTopic {
                name: name.chars().take(MAX_LEN + 1).collect(),
            });
        }
        Ok(Topic::of(name))
    }

    /// Checks the name of a topic that a publisher with other rules made.
    ///
    /// It accepts any characters but control characters and `/`, as far as a file can have the
    /// name. For reading: a [`Publisher`](crate::Publisher) refuses a name that [`Topic::new`]
    /// refuses.
    ///
    /// ```
    /// use conduit_ring::Topic;
    ///
    /// let topic = Topic::found("front:rgb")?;
    /// assert_eq!(topic.path().to_str(), Some("/dev/shm/conduit_front:rgb"));
    /// assert!(Topic::found("../etc/passwd").is_err());
    /// # Ok::<(), conduit_ring::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::InvalidTopic`] when no file of the directory can have the name.
    pub fn found(name: &str) -> Result<Topic, Error> {
        let accepted = (1..=MAX_FOUND_LEN).contains(&name.len())
            && !name.chars().any(|c| c == '/' || c.is_control());
        if accepted {
            Ok(Topic::of(name))
        } else {
            Topic::new(name)
        }
    }

    fn of(name: &str) -> Topic {
        Topic {
            path: directory().join(format!("{PREFIX}{name}")),
            name: name.to_owned(),
        }
    }

    /// Returns the name as given.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the path of the segment's file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn is_allowed(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || b"_.-".contains(&byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_directory_is_shared_memory_unless_another_is_named() {
        assert_eq!(named(None), Path::new("/dev/shm"));
        assert_eq!(named(Some("".into())), Path::new("/dev/shm"));
        assert_eq!(
            named(Some("/dev/shm/arm".into())),
            Path::new("/dev/shm/arm")
        );
    }

    #[test]
    fn names_of_1_to_200_plain_characters_are_accepted() {
        for name in ["a", "camera.front-left_2", "..", &"x".repeat(200)] {
            assert_eq!(Topic::new(name).unwrap().name(), name);
        }
    }

    #[test]
    fn every_other_name_is_refused() {
        for name in ["", "a/b", "a b", "ä", "a\0", "a\n", &"x".repeat(201)] {
            assert!(Topic::new(name).is_err(), "{name:?}");
        }
    }

    #[test]
    fn names_by_the_rules_of_others_are_found_and_not_made() {
        for name in ["cam 1", "front:rgb", "größe", "a,b;c|d", &"x".repeat(247)] {
            assert_eq!(Topic::found(name).unwrap().name(), name);
            assert!(Topic::new(name).is_err(), "{name:?}");
        }
        for name in [
            "",
            "a/b",
            "a\0",
            "a\n",
            "\u{1b}[2J",
            "\u{85}",
            &"x".repeat(248),
        ] {
            assert!(Topic::found(name).is_err(), "{name:?}");
        }
    }
}
