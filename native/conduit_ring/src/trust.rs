//! Whose files are mapped.
//!
//! Whoever owns a file can shorten it at any moment, which is SIGBUS for all who have it mapped. `/dev/shm` is open to all
//! users of a machine, so that anyone can make a file of a topic's name. Hence a file of another user is never mapped: nobody
//! publishes into it, and it is read by `pread` alone. Programs that run as users of their own name each other here.
//!
//! Trusted are this process's own user, and the users and groups that [`Trusted::apply`] or else the environment lists:
//! `CONDUIT_RING_TRUSTED_UIDS` and `CONDUIT_RING_TRUSTED_GIDS`, numbers or names with commas between. They are not read by a
//! program that was started with more rights than its user has (setuid).

use std::path::Path;
use std::sync::{PoisonError, RwLock};

use crate::error::Error;
use crate::os::{self, FileOwner, Segment};
use crate::topic::{Topic, directory};

/// The variable of the environment that lists users.
pub const USERS_VARIABLE: &str = "CONDUIT_RING_TRUSTED_UIDS";
/// The variable of the environment that lists groups.
pub const GROUPS_VARIABLE: &str = "CONDUIT_RING_TRUSTED_GIDS";

const USERS_FILE: &str = "/etc/passwd";
const GROUPS_FILE: &str = "/etc/group";

/// Users and groups whose files are treated as one's own.
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
    /// Group numbers. A file counts by its group, unless the directory gives its own group to all files.
    pub groups: Vec<u32>,
}

/// What [`Trusted::apply`] was given last, for the whole process.
static APPLIED: RwLock<Option<Trusted>> = RwLock::new(None);

impl Trusted {
    /// Reads two lists of numbers or names with commas between.
    ///
    /// # Errors
    /// [`Error::InvalidTrust`] for what is neither a number nor a name that this machine knows.
    pub fn parse(users: &str, groups: &str) -> Result<Trusted, Error> {
        Ok(Trusted {
            users: numbers(users, "user", USERS_FILE)?,
            groups: numbers(groups, "group", GROUPS_FILE)?,
        })
    }

    /// What the environment lists.
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

    /// Trusts these, and no longer those that the environment lists, in all of this process from now on.
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

/// The name of a user, if this machine knows one.
pub fn user_name(user: u32) -> Option<String> {
    let users = os::text_of(Path::new(USERS_FILE));
    let mut entries = users.lines().filter_map(entry);
    entries
        .find(|&(_, number)| number == user)
        .map(|(name, _)| name.to_owned())
}

/// Whether a file belongs to someone who is not trusted.
pub(crate) fn is_foreign(topic: &Topic, segment: &Segment) -> Result<bool, Error> {
    let owner = segment.owner().map_err(Error::os("stat", topic.path()))?;
    Ok(!is_trusted(owner)?)
}

/// An error if a file belongs to someone who is not trusted.
pub(crate) fn require(topic: &Topic, segment: &Segment) -> Result<(), Error> {
    let owner = segment.owner().map_err(Error::os("stat", topic.path()))?;
    if is_trusted(owner)? {
        Ok(())
    } else {
        Err(refusal(topic, owner))
    }
}

/// Why a file could not be opened: since it belongs to someone else, if it does.
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
                "expected numbers or names of {kind}s with commas between, got: {word:?}"
            ),
        })
}

/// Name and number of a line of /etc/passwd or /etc/group.
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
    fn what_is_neither_is_refused_with_what_was_given() {
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
