//! Which users' files are mapped.
//!
//! The owner of a file can shorten it at any moment, and every process that has it mapped then
//! gets SIGBUS. `/dev/shm` is open to all users of a machine, so that any of them can make a file
//! with a topic's name. Hence a stranger's file is never mapped: publishers refuse it
//! ([`Error::ForeignOwner`]), and subscribers read it by `pread` alone ([`Guard`](crate::Guard)).
//! Programs that run as users of their own name each other here.
//!
//! Three sources decide about a file, in this order:
//!
//! 1. The file of the process's own user is trusted.
//! 2. After [`Trusted::apply`], the users and groups that it was given, and no others.
//! 3. Otherwise those that the environment lists in `CONDUIT_RING_TRUSTED_UIDS` and
//!    `CONDUIT_RING_TRUSTED_GIDS`: numbers or names, separated by commas. A program that was
//!    started with more rights than its user has (setuid) does not read them.
//!
//! ```sh
//! CONDUIT_RING_TRUSTED_UIDS=vision,camera my_program
//! ```

use std::path::Path;
use std::sync::{PoisonError, RwLock};

use crate::error::Error;
use crate::os::{self, FileOwner, Segment};
use crate::topic::{Topic, directory};

/// The variable of the environment that lists trusted users.
pub const USERS_VARIABLE: &str = "CONDUIT_RING_TRUSTED_UIDS";
/// The variable of the environment that lists trusted groups.
pub const GROUPS_VARIABLE: &str = "CONDUIT_RING_TRUSTED_GIDS";

const USERS_FILE: &str = "/etc/passwd";
const GROUPS_FILE: &str = "/etc/group";

/// Users and groups whose files are treated as the process's own.
///
/// ```
/// use conduit_ring::trust::Trusted;
///
/// let trusted = Trusted::parse("0, 1001", "")?;
/// assert_eq!(trusted.users, [0, 1001]);
/// trusted.apply();
/// # conduit_ring::trust::Trusted::default().apply();
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Trusted {
    /// User numbers.
    pub users: Vec<u32>,
    /// Group numbers. A file counts by its group, unless the directory gives its own group to all
    /// files: then the group says nothing about who made the file.
    pub groups: Vec<u32>,
}

/// The list that [`Trusted::apply`] was given last, for the whole process.
static APPLIED: RwLock<Option<Trusted>> = RwLock::new(None);

impl Trusted {
    /// Parses two lists of numbers or names, separated by commas.
    ///
    /// # Errors
    /// [`Error::InvalidTrust`] for an entry that is neither a number nor a name that this machine
    /// knows.
    pub fn parse(users: &str, groups: &str) -> Result<Trusted, Error> {
        Ok(Trusted {
            users: numbers(users, "user", USERS_FILE)?,
            groups: numbers(groups, "group", GROUPS_FILE)?,
        })
    }

    /// Returns the users and groups that the environment lists.
    ///
    /// # Errors
    /// As [`Trusted::parse`].
    pub fn of_environment() -> Result<Trusted, Error> {
        if os::has_gained_rights() {
            return Ok(Trusted::default());
        }
        let list = |name| std::env::var(name).unwrap_or_default();
        Trusted::parse(&list(USERS_VARIABLE), &list(GROUPS_VARIABLE))
    }

    /// Trusts these users and groups from now on, in all of this process, and no longer those
    /// that the environment lists.
    pub fn apply(self) {
        *APPLIED.write().unwrap_or_else(PoisonError::into_inner) = Some(self);
    }

    fn current() -> Result<Trusted, Error> {
        let applied = APPLIED.read().unwrap_or_else(PoisonError::into_inner);
        applied.clone().map_or_else(Trusted::of_environment, Ok)
    }

    fn covers(&self, owner: FileOwner) -> bool {
        self.users.contains(&owner.user)
            || (self.groups.contains(&owner.group) && !os::gives_group(directory()))
    }
}

/// Returns the name of a user, if this machine knows one.
///
/// ```
/// use conduit_ring::trust::user_name;
///
/// assert_eq!(user_name(0).as_deref(), Some("root"));
/// assert_eq!(user_name(4_000_000_000), None);
/// ```
pub fn user_name(user: u32) -> Option<String> {
    let users = os::text_of(Path::new(USERS_FILE));
    let mut entries = users.lines().filter_map(entry);
    entries
        .find(|&(_, number)| number == user)
        .map(|(name, _)| name.to_owned())
}

/// Returns whether a file belongs to a user who is not trusted.
pub(crate) fn is_foreign(topic: &Topic, segment: &Segment) -> Result<bool, Error> {
    let owner = segment.owner().map_err(Error::os("stat", topic.path()))?;
    Ok(!is_trusted(owner)?)
}

/// Returns an error if a file belongs to a user who is not trusted.
pub(crate) fn require(topic: &Topic, segment: &Segment) -> Result<(), Error> {
    let owner = segment.owner().map_err(Error::os("stat", topic.path()))?;
    if is_trusted(owner)? {
        Ok(())
    } else {
        Err(refusal(topic, owner))
    }
}

/// Explains why a file could not be opened: if a stranger owns it, that is the reason.
pub(crate) fn explain(topic: &Topic, error: Error) -> Error {
    match os::owner_of(topic.path()) {
        Ok(owner) if matches!(is_trusted(owner), Ok(false)) => refusal(topic, owner),
        _ => error,
    }
}

fn is_trusted(owner: FileOwner) -> Result<bool, Error> {
    if owner.user == os::own_user() {
        return Ok(true);
    }
    Trusted::current().map(|trusted| trusted.covers(owner))
}

fn refusal(topic: &Topic, owner: FileOwner) -> Error {
    Error::ForeignOwner {
        path: topic.path().to_owned(),
        user: owner.user,
        name: user_name(owner.user),
    }
}

fn numbers(list: &str, kind: &str, file: &str) -> Result<Vec<u32>, Error> {
    let given = list
        .split(',')
        .map(str::trim)
        .filter(|word| !word.is_empty());
    given.map(|word| number(word, kind, file)).collect()
}

fn number(word: &str, kind: &str, file: &str) -> Result<u32, Error> {
    let known = || {
        let text = os::text_of(Path::new(file));
        let found = text
            .lines()
            .filter_map(entry)
            .find(|(name, _)| *name == word);
        found.map(|(_, number)| number)
    };
    word.parse()
        .ok()
        .or_else(known)
        .ok_or_else(|| Error::InvalidTrust {
            reason: format!(
                "expected numbers or names of {kind}s, separated by commas, got: {word:?}"
            ),
        })
}

/// Returns name and number of a line of /etc/passwd or /etc/group.
fn entry(line: &str) -> Option<(&str, u32)> {
    let mut fields = line.split(':');
    let name = fields.next()?;
    Some((name, fields.nth(1)?.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_take_numbers_and_names() {
        let trusted = Trusted::parse(" 1001,root , ", "root,7").unwrap();
        assert_eq!((trusted.users, trusted.groups), (vec![1001, 0], vec![0, 7]));
        assert_eq!(Trusted::parse("", "").unwrap(), Trusted::default());
    }

    #[test]
    fn an_entry_that_is_neither_is_refused_and_shown() {
        for bad in ["no such user", "-1", "4294967296", "1;2"] {
            let error = Trusted::parse(bad, "").unwrap_err().to_string();
            assert!(error.contains(&format!("got: {bad:?}")), "{error}");
        }
    }

    #[test]
    fn users_have_names() {
        assert_eq!(user_name(0).as_deref(), Some("root"));
        assert_eq!(user_name(4_000_000_000), None);
        assert_eq!(
            entry("vision:x:1001:1001::/:/bin/sh"),
            Some(("vision", 1001))
        );
        assert_eq!(entry("no entry"), None);
    }

    #[test]
    fn a_listed_user_or_group_covers_a_file() {
        let trusted = Trusted {
            users: vec![1001],
            groups: vec![50],
        };
        let owner = |user, group| FileOwner { user, group };
        assert!(trusted.covers(owner(1001, 9)) && trusted.covers(owner(7, 50)));
        assert!(!trusted.covers(owner(7, 1001)) && !trusted.covers(owner(50, 7)));
    }
}
