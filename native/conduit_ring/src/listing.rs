//! Which topics there are.

use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::segment;
use crate::topic::{DIRECTORY, PREFIX, Topic};

/// What lies in `/dev/shm` under a topic's name or what should be one, by name. Nothing of it has been opened: whether it
/// is a ring tells [`Info::read`](crate::Info::read).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Listing {
    /// The topics.
    pub topics: Vec<Topic>,
    /// What begins as a segment's file does and goes on as no topic's name does.
    pub misnamed: Vec<PathBuf>,
}

impl Listing {
    /// Looks into the directory.
    ///
    /// # Errors
    /// [`Error::Os`] when it cannot be read.
    pub fn read() -> Result<Listing, Error> {
        let directory = Path::new(DIRECTORY);
        let mut listing = Listing::default();
        for name in segment::names_in(directory).map_err(Error::os("list", directory))? {
            listing.add(&name.to_string_lossy(), directory.join(&name));
        }
        listing.topics.sort_by(|a, b| a.name().cmp(b.name()));
        listing.misnamed.sort();
        Ok(listing)
    }

    fn add(&mut self, file_name: &str, path: PathBuf) {
        let Some(name) = file_name.strip_prefix(PREFIX) else {
            return;
        };
        match Topic::new(name) {
            Ok(topic) => self.topics.push(topic),
            Err(_) => self.misnamed.push(path),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_others_are_passed_over_and_misnamed_ones_are_told() {
        let mut listing = Listing::default();
        for name in ["conduit_imu", "sem.x", "conduit_", "conduit_a b"] {
            listing.add(name, Path::new(DIRECTORY).join(name));
        }
        assert_eq!(listing.topics, [Topic::new("imu").unwrap()]);
        assert_eq!(
            listing.misnamed,
            ["/dev/shm/conduit_", "/dev/shm/conduit_a b"].map(PathBuf::from)
        );
    }
}
