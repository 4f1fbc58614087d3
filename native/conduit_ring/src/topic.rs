//! The name of a ring.

use std::path::{Path, PathBuf};

use crate::error::Error;

/// Where segments live.
pub(crate) const DIRECTORY: &str = "/dev/shm";
/// What the name of a segment begins with.
pub(crate) const PREFIX: &str = "conduit_";
const MAX_LEN: usize = 200;

/// A checked topic name: `[A-Za-z0-9_.-]{1,200}`, so that it can name nothing but a segment.
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
    /// Checks a name; [`Error::InvalidTopic`] says what was given and what is accepted.
    pub fn new(name: &str) -> Result<Topic, Error> {
        let accepted = (1..=MAX_LEN).contains(&name.len()) && name.bytes().all(is_allowed);
        if !accepted {
            return Err(Error::InvalidTopic {
                name: name.chars().take(MAX_LEN + 1).collect(),
            });
        }
        let path = Path::new(DIRECTORY).join(format!("{PREFIX}{name}"));
        Ok(Topic {
            path,
            name: name.to_owned(),
        })
    }

    /// The name as given.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The segment's file.
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
}
