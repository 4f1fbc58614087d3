//! The thread of a subscriber: it alone reads the ring, and sends the messages on.

use std::time::Duration;

use conduit_ring::{ContentTag, Error, Lease, Meta, Policy, Received, Subscriber};
use rustler::{Atom, LocalPid, ResourceArc};

use crate::buffer::Buffer;
use crate::content::Expected;
use crate::demand::{Next, Request};
use crate::sender::Sender;
use crate::subscription::{Caller, Kind, SubscriberResource};
use crate::terms::atoms;

/// The longest time that the thread waits for a message. A request wakes it at once.
const LONGEST_WAIT: Duration = Duration::from_millis(500);

/// The thread's state.
pub struct Reader {
    pub ring: Subscriber,
    pub policy: Policy,
    /// Keeps the resource alive: like a port, a subscription lives until its owner dies or closes
    /// it, even without a reference.
    pub resource: ResourceArc<SubscriberResource>,
    pub sender: Sender,
    pub last_error: Option<String>,
    pub expected: Expected,
    /// The unexpected content that the owner was last notified of.
    pub rejected: Option<ContentTag>,
}

impl Reader {
    /// Serves requests and deliveries until the subscription closes, then releases the ring.
    pub fn run(mut self) {
        while let Some(next) = self.resource.0.next() {
            match next {
                Next::Answer(request) => match request.caller.kind {
                    Kind::Next => self.answer(request),
                    Kind::Latest => self.answer_latest(request.caller.pid, request.id),
                    Kind::Frame => self.answer_frame(request.caller.pid, request.id),
                },
                Next::Deliver => self.deliver(),
                Next::Park => {}
            }
        }
        self.end();
    }

    fn end(self) {
        let Self {
            ring,
            resource,
            mut sender,
            ..
        } = self;
        drop(ring);
        let mut state = resource.0.lock();
        state.ended = true;
        for request in state.demand.drain() {
            sender.answer(&request.caller.pid, request.id, Err(atoms::closed()));
        }
        for closer in &state.closers {
            sender.send_closed(closer);
        }
    }

    fn deliver(&mut self) {
        let Some((meta, data)) = self.read() else {
            return self.wait();
        };
        // Counts the message before it sends it, because the receiver may request the next one at
        // once.
        let passive = self.resource.0.lock().demand.count_delivery();
        self.sender.send_message(meta, data);
        if passive {
            self.sender.send_passive();
        }
    }

    fn answer(&mut self, request: Request<Caller>) {
        if let Some((meta, data)) = self.read() {
            return self
                .sender
                .answer(&request.caller.pid, request.id, Ok((meta, data)));
        }
        let cancelled = self.resource.0.lock().demand.postpone(request);
        match cancelled {
            Some(request) => {
                self.sender
                    .answer(&request.caller.pid, request.id, Err(atoms::timeout()))
            }
            None => self.wait(),
        }
    }

    fn answer_latest(&mut self, caller: LocalPid, id: u64) {
        self.ring.set_policy(Policy::Latest);
        let result = self.read().ok_or_else(atoms::empty);
        self.ring.set_policy(self.policy);
        self.sender.answer(&caller, id, result);
    }

    fn answer_frame(&mut self, caller: LocalPid, id: u64) {
        self.ring.set_policy(Policy::Latest);
        let lease = self.lease();
        self.ring.set_policy(self.policy);
        self.sender.lend(&caller, id, lease);
    }

    fn lease(&mut self) -> Result<Lease, Atom> {
        loop {
            match self.ring.try_lease() {
                Ok(Received::Message(_meta, _lease)) if self.rejects_content() => {}
                Ok(Received::Message(_meta, lease)) => return Ok(lease),
                Ok(Received::Nothing) => return Err(atoms::empty()),
                Ok(Received::PublisherUp) => self.sender.send_event(atoms::publisher_up()),
                Ok(Received::PublisherDown) => self.sender.send_event(atoms::publisher_down()),
                Err(Error::TooManyLeases { .. }) => return Err(atoms::too_many_leases()),
                Err(error) => {
                    self.report(&error);
                    return Err(atoms::empty());
                }
            }
        }
    }

    /// Returns the next message, if there is one now. Sends other events of the ring to the
    /// owner.
    fn read(&mut self) -> Option<(Meta, Buffer)> {
        loop {
            match self.ring.try_read_with(Buffer::with_len) {
                Ok(Received::Message(_meta, _data)) if self.rejects_content() => {}
                Ok(Received::Message(meta, data)) => return Some((meta, data)),
                Ok(Received::Nothing) => return None,
                Ok(Received::PublisherUp) => self.sender.send_event(atoms::publisher_up()),
                Ok(Received::PublisherDown) => self.sender.send_event(atoms::publisher_down()),
                Err(error) => {
                    self.report(&error);
                    return None;
                }
            }
        }
    }

    /// Returns whether the topic has unexpected content, and notifies the owner once. Messages of
    /// such a topic are discarded.
    fn rejects_content(&mut self) -> bool {
        let unexpected = self.expected.unexpected(&self.ring);
        if let Some(content) = unexpected
            && self.rejected != Some(content)
        {
            self.sender.send_other_content(content);
        }
        self.rejected = unexpected;
        unexpected.is_some()
    }

    /// Waits for a message. Checks the content first, so that the owner learns of unexpected
    /// content before the first message arrives.
    fn wait(&mut self) {
        self.rejects_content();
        if let Err(error) = self.ring.wait(LONGEST_WAIT) {
            self.report(&error);
            // A wait that fails at once must not become a busy loop.
            self.resource.0.pause(LONGEST_WAIT);
        }
    }

    /// Sends an error, such as a missing reader slot, to the owner, once until it changes.
    fn report(&mut self, error: &Error) {
        let text = error.to_string();
        if self.last_error.as_ref() != Some(&text) {
            self.sender.send_error(error);
            self.last_error = Some(text);
        }
    }
}
