//! The NIFs of a publisher: the writing end of a topic as a resource.

use conduit_ring::{ContentTag, Geometry, Publisher, PublisherOptions, Topic};
use rustler::{Atom, Binary, Env, NifMap, NifResult, ResourceArc, Term};

use crate::exclusive::Exclusive;
use crate::name_watch;
use crate::publication::{Held, PublisherResource, publish};
use crate::terms::{self, InfoTerm, atoms, failure};

/// The options that `BB.Ring.Publisher.open/2` has checked and completed.
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
    name_watch::watch(resource.clone(), env.pid(), topic);
    Ok(terms::ok(env, resource))
}

/// Returns `{:error, reason}` while the topic's name is lost, otherwise `:ok`.
#[rustler::nif]
fn publisher_trouble(env: Env, resource: ResourceArc<PublisherResource>) -> Term {
    let trouble = |held: &mut Held| {
        let trouble = held.publisher.as_ref().and_then(Publisher::trouble);
        trouble.map(|trouble| failure(env, trouble))
    };
    match resource.0.try_with(trouble) {
        Ok(Some(failure)) => failure,
        Ok(None) => rustler::types::atom::ok().to_term(env),
        Err(unavailable) => terms::error(env, Atom::from(unavailable)),
    }
}

/// As `publish_binary`, from a list of binaries.
#[rustler::nif]
fn publish_iovec(resource: ResourceArc<PublisherResource>, data: Vec<Binary>) -> Atom {
    publish_all(&resource, &data)
}

/// As `publish_iovec`, for messages that take too long for a normal scheduler.
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
        Err(unavailable) => unavailable.into(),
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
        Err(unavailable) => terms::error(env, Atom::from(unavailable)),
    }
}

fn publish_all(resource: &PublisherResource, data: &[Binary]) -> Atom {
    let slices: Vec<&[u8]> = data.iter().map(Binary::as_slice).collect();
    publish(resource, |publisher| publisher.publish_slices(&slices))
}
