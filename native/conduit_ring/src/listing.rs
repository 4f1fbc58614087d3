//! Which topics exist.

use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;

use crate::error::Error;
use crate::os;
use crate::topic::{PREFIX, Topic, directory};

/// The topics of the machine, sorted by name.
///
/// A listing reads the directory and opens no file. Whether a file is a ring, and whether its
/// publisher lives, says [`Info::read`](crate::Info::read).
///
/// ```
/// use conduit_ring::{Info, Listing, Publisher, PublisherOptions, State, Topic};
///
/// # let name = format!("doc-listing-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let _publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// let listing = Listing::read()?;
/// assert!(listing.topics.contains(&topic));
/// assert_eq!(Info::read(&topic)?.state, State::Live);
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Listing {
    /// The topics.
    pub topics: Vec<Topic>,
    /// Files whose name begins as a segment's does, and whose rest [`Topic::found`] refuses.
    pub misnamed: Vec<PathBuf>,
}

impl Listing {
    /// Reads the directory.
    ///
    /// # Errors
    /// [`Error::Os`] when the directory cannot be read.
    pub fn read() -> Result<Listing, Error> {
        let directory = directory();
        let mut listing = Listing::default();
        for name in os::names_in(directory).map_err(Error::os("list", directory))? {
            listing.add(name.to_str(), directory.join(&name));
        }
        listing.topics.sort_by(|a, b| a.name().cmp(b.name()));
        listing.misnamed.sort();
        Ok(listing)
    }

    /// `file_name` is `None` when it is not UTF-8.
    fn add(&mut self, file_name: Option<&str>, path: PathBuf) {
        let begins = |name: &[u8]| name.starts_with(PREFIX.as_bytes());
        if !path.file_name().is_some_and(|name| begins(name.as_bytes())) {
            return;
        }
        match file_name.map(|name| Topic::found(&name[PREFIX.len()..])) {
            Some(Ok(topic)) => self.topics.push(topic),
            _ => self.misnamed.push(path),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::ffi::OsStr;

    use super::*;

    #[test]
    fn files_of_others_are_skipped_and_misnamed_ones_are_listed() {
        let mut listing = Listing::default();
        for name in [
            "conduit_imu",
            "sem.x",
            "conduit_",
            "conduit_a b",
            "conduit_\n",
        ] {
            listing.add(Some(name), directory().join(name));
        }
        let no_text = OsStr::from_bytes(b"conduit_\xff");
        listing.add(no_text.to_str(), directory().join(no_text));
        assert_eq!(
            listing.topics,
            ["imu", "a b"].map(|name| Topic::found(name).unwrap())
        );
        assert_eq!(
            listing.misnamed,
            [OsStr::new("conduit_"), OsStr::new("conduit_\n"), no_text]
                .map(|name| directory().join(name))
        );
    }
}
