//! The writing end of a topic as a resource.

use conduit_ring::{ContentTag, Geometry, PublishError, Publisher, PublisherOptions, Topic};
use rustler::{
    Atom, Binary, Env, LocalPid, Monitor, NifMap, NifResult, Resource, ResourceArc, Term,
};

use crate::exclusive::{Exclusive, Refused};
use crate::names;
use crate::terms::{self, InfoTerm, atoms, failure};

/// Two processes that publish at once exclude each other here: the one that comes second is told to try again.
pub struct PublisherResource(Exclusive<Held>);

/// A publisher that, dropped, leaves its topic as it is, so that a successor goes on in place.
#[derive(Default)]
struct Held {
    publisher: Option<Publisher>,
    /// Its own resource: as a port, a publisher lives until its owner dies or closes it, whoever refers to it.
    alive: Option<ResourceArc<PublisherResource>>,
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

    /// The owner died.
    fn down<'a>(&'a self, _env: Env<'a>, _pid: LocalPid, _monitor: Monitor) {
        self.0.retire();
    }
}

/// What `BB.Ring.Publisher.open/2` has checked and filled in.
#[derive(NifMap)]
struct OpenOptions {
    slot_count: u32,
    slot_size: u32,
    content: Option<String>,
    mode: u32,
    force: bool,
}

impl OpenOptions {
    fn build(&self) -> Result<PublisherOptions, conduit_ring::Error> {
        Ok(PublisherOptions {
            geometry: Geometry::slots(self.slot_count, self.slot_size)?,
            content: self
                .content
                .as_deref()
                .map_or(ContentTag::RAW, ContentTag::of),
            mode: self.mode,
            force: self.force,
            ..PublisherOptions::default()
        })
    }
}

#[rustler::nif(schedule = "DirtyIo")]
fn publisher_open<'a>(env: Env<'a>, topic: &str, options: OpenOptions) -> NifResult<Term<'a>> {
    let opened = Topic::new(topic).and_then(|topic| Publisher::open(&topic, &options.build()?));
    let publisher = match opened {
        Ok(publisher) => publisher,
        Err(error) => return Ok(failure(env, &error)),
    };
    let held = Held {
        publisher: Some(publisher),
        alive: None,
    };
    let resource = ResourceArc::new(PublisherResource(Exclusive::new(held)));
    let _free = resource
        .0
        .try_with(|held| held.alive = Some(resource.clone()));
    if resource.monitor(Some(env), &env.pid()).is_none() {
        resource.0.retire();
    }
    names::watch(resource.clone(), env.pid(), topic);
    Ok(terms::ok(env, resource))
}

/// Why the topic's name is lost: `{:error, reason}`, or `:ok` when it is not any more.
#[rustler::nif]
fn publisher_trouble(env: Env, resource: ResourceArc<PublisherResource>) -> Term {
    let trouble = |held: &mut Held| {
        let trouble = held.publisher.as_ref().and_then(Publisher::trouble);
        trouble.map(|trouble| failure(env, trouble))
    };
    match resource.0.try_with(trouble) {
        Ok(Some(failure)) => failure,
        Ok(None) => rustler::types::atom::ok().to_term(env),
        Err(refused) => terms::error(env, Atom::from(refused)),
    }
}

/// What became of a look after a topic's name.
pub enum Looked {
    /// All is well, and the file was made anew so many times.
    Well(u64),
    /// The name is lost.
    Lost,
    /// Another thread publishes just now, and looks by itself.
    Busy,
    /// The publisher is closed.
    Gone,
}

/// Looks after a topic's name.
pub fn look_after(resource: &PublisherResource) -> Looked {
    let looked = resource.0.try_with(|held| {
        let publisher = held.publisher.as_mut()?;
        Some(publisher.look_after().map(|()| publisher.renewals()))
    });
    match looked {
        Ok(Some(Ok(renewals))) => Looked::Well(renewals),
        Ok(Some(Err(_))) => Looked::Lost,
        Ok(None) | Err(Refused::Gone) => Looked::Gone,
        Err(Refused::Busy) => Looked::Busy,
    }
}

/// Tells of the trouble that a publisher is in, if it is.
pub fn with_trouble<T>(
    resource: &PublisherResource,
    tell: impl FnOnce(&conduit_ring::Error) -> T,
) -> Option<T> {
    let told = resource.0.try_with(|held| {
        let trouble = held.publisher.as_ref().and_then(Publisher::trouble);
        trouble.map(tell)
    });
    told.ok().flatten()
}

/// As `hot::publish_binary`, from a list of binaries.
#[rustler::nif]
fn publish_iovec(resource: ResourceArc<PublisherResource>, data: Vec<Binary>) -> Atom {
    publish_all(&resource, &data)
}

/// As `publish_iovec`, for messages that take longer than a normal scheduler should be held.
#[rustler::nif(schedule = "DirtyCpu")]
fn publish_large(resource: ResourceArc<PublisherResource>, data: Vec<Binary>) -> Atom {
    publish_all(&resource, &data)
}

#[rustler::nif(schedule = "DirtyIo")]
fn publisher_close(resource: ResourceArc<PublisherResource>) -> Atom {
    match resource.0.try_with(std::mem::take) {
        Ok(mut held) => held
            .publisher
            .take()
            .map(Publisher::close)
            .map_or_else(atoms::closed, |()| rustler::types::atom::ok()),
        Err(refused) => refused.into(),
    }
}

#[rustler::nif]
fn publisher_info(env: Env, resource: ResourceArc<PublisherResource>) -> Term {
    match resource
        .0
        .try_with(|held| held.publisher.as_ref().map(Publisher::info))
    {
        Ok(Some(info)) => terms::ok(env, InfoTerm::from(info)),
        Ok(None) => terms::error(env, atoms::closed()),
        Err(refused) => terms::error(env, Atom::from(refused)),
    }
}

fn publish_all(resource: &PublisherResource, data: &[Binary]) -> Atom {
    let slices: Vec<&[u8]> = data.iter().map(Binary::as_slice).collect();
    publish(resource, |publisher| publisher.publish_slices(&slices))
}

/// `:ok`, or the atom of what went otherwise; `:busy` asks for another try.
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
        Err(refused) => refused.into(),
    }
}

impl From<Refused> for Atom {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Busy => atoms::busy(),
            Refused::Gone => atoms::closed(),
        }
    }
}
