//! The resource of a publisher and the operations on it.

use conduit_ring::{Error, PublishError, Publisher};
use rustler::{Atom, Env, LocalPid, Monitor, Resource, ResourceArc};

use crate::exclusive::{Exclusive, Unavailable};
use crate::terms::{self, atoms};

/// A publisher as a resource. When two processes publish at once, the second one gets `:busy` and
/// tries again.
pub struct PublisherResource(pub Exclusive<Held>);

/// A publisher that leaves its topic in place on drop, so that a successor can take it over.
#[derive(Default)]
pub struct Held {
    pub publisher: Option<Publisher>,
    /// The publisher's own resource: like a port, a publisher lives until its owner dies or
    /// closes it, even without a reference.
    pub alive: Option<ResourceArc<PublisherResource>>,
}

impl Drop for Held {
    fn drop(&mut self) {
        if let Some(publisher) = self.publisher.take() {
            publisher.abandon();
        }
    }
}

#[rustler::resource_impl]
impl Resource for PublisherResource {
    const IMPLEMENTS_DOWN: bool = true;

    /// Abandons the topic when the owner dies.
    fn down<'a>(&'a self, _env: Env<'a>, _pid: LocalPid, _monitor: Monitor) {
        self.0.retire();
    }
}

/// The result of a check of a topic's name.
pub enum NameCheck {
    /// The topic has its name; the number of times that its file was created again.
    Named(u64),
    /// The name is lost.
    Lost,
    /// Another thread is publishing, which checks the name too.
    Busy,
    /// The publisher is closed.
    Closed,
}

/// Checks a topic's name and creates its file again if necessary.
pub fn check_name(resource: &PublisherResource) -> NameCheck {
    let checked = resource.0.try_with(|held| {
        let publisher = held.publisher.as_mut()?;
        Some(publisher.look_after().map(|()| publisher.renewals()))
    });
    match checked {
        Ok(Some(Ok(renewals))) => NameCheck::Named(renewals),
        Ok(Some(Err(_))) => NameCheck::Lost,
        Ok(None) | Err(Unavailable::Retired) => NameCheck::Closed,
        Err(Unavailable::Busy) => NameCheck::Busy,
    }
}

/// Passes the reason why the topic's name is lost to `handle`, if it is lost.
pub fn with_trouble<T>(
    resource: &PublisherResource,
    handle: impl FnOnce(&Error) -> T,
) -> Option<T> {
    let handled = resource.0.try_with(|held| {
        let trouble = held.publisher.as_ref().and_then(Publisher::trouble);
        trouble.map(handle)
    });
    handled.ok().flatten()
}

/// Publishes with `write`. Returns `:ok` or the atom of an error. After `:busy` the caller tries
/// again.
#[inline]
pub fn publish(
    resource: &PublisherResource,
    write: impl FnOnce(&mut Publisher) -> Result<u64, PublishError>,
) -> Atom {
    match resource
        .0
        .try_with(|held| held.publisher.as_mut().map(write))
    {
        Ok(Some(Ok(_sequence))) => rustler::types::atom::ok(),
        Ok(Some(Err(error))) => terms::publish_error(&error),
        Ok(None) => atoms::closed(),
        Err(unavailable) => unavailable.into(),
    }
}

impl From<Unavailable> for Atom {
    fn from(unavailable: Unavailable) -> Self {
        match unavailable {
            Unavailable::Busy => atoms::busy(),
            Unavailable::Retired => atoms::closed(),
        }
    }
}
