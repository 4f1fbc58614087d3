//! One who reads a topic.

use std::fmt;
use std::time::{Duration, Instant};

use crate::attachment::{Attachment, Beginning, Incarnation, Life, Part, Past};
use crate::content::ContentTag;
use crate::delivery::{Meta, Policy};
use crate::error::Error;
use crate::geometry::Geometry;
use crate::guarded::Guard;
use crate::lease::Lease;
use crate::options::SubscriberOptions;
use crate::os::{self, Watch};
use crate::owner::Owner;
use crate::sink::{IntoNew, IntoVec};
use crate::topic::{Topic, directory};
use crate::wait::LONGEST_SLEEP;
use crate::waker::Waker;

/// How long a sleep may be while a file is there that is not yet a segment, or the directory cannot be watched.
const UNWATCHED_SLEEP: Duration = Duration::from_millis(50);

/// Between two looks at a topic on which there is no word to sleep on, from after a message on.
const SHORTEST_NAP: Duration = Duration::from_millis(1);
const LONGEST_NAP: Duration = Duration::from_millis(4);

/// What a look at a topic gave.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// A message; it is in the buffer.
    Message(Meta),
    /// Nothing new.
    Nothing,
    /// The topic has a publisher again, or for the first time.
    PublisherUp,
    /// The publisher died, closed the topic or was replaced. Whatever it had published was delivered before.
    PublisherDown,
}

/// What a look at a topic gave, with the buffer that the message was copied into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received<B> {
    /// A message.
    Message(Meta, B),
    /// As [`Read::Nothing`].
    Nothing,
    /// As [`Read::PublisherUp`].
    PublisherUp,
    /// As [`Read::PublisherDown`].
    PublisherDown,
}

/// Why a wait ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// [`Subscriber::try_read`] has something to say.
    Ready,
    /// A [`Waker`] was used.
    Woken,
    /// The time is up.
    TimedOut,
}

/// What a subscriber has seen so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Stats {
    /// Messages delivered.
    pub delivered: u64,
    /// Messages lost.
    pub lost: u64,
    /// Times that the publisher's count was found behind the reader's.
    pub resyncs: u64,
}

/// One reader of a topic, in a reader slot of its own.
///
/// It outlives publishers: when one dies it says so, and goes on with the next one by itself.
pub struct Subscriber {
    topic: Topic,
    part: Part,
    guard: Guard,
    policy: Policy,
    tie: Tie,
    waker: Waker,
    publisher_up: bool,
    pending: Option<Change>,
    next_look: Instant,
    past: Stats,
    owner: Owner,
    /// How long the next sleep on a stranger's topic is.
    nap: Duration,
}

/// What the subscriber holds on to.
enum Tie {
    Attached(Attachment),
    Awaiting { watch: Option<Watch>, past: Past },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Change {
    Up,
    Down,
}

/// What a step came to, before it is told in the caller's words.
enum Step<T> {
    Message(T),
    Change(Change),
    Nothing,
}

impl Subscriber {
    /// Subscribes to a topic, which need not exist yet.
    ///
    /// # Errors
    /// [`Error::NoReaderSlot`] for a 17th subscriber; [`Error::BadSegment`]; [`Error::Os`].
    pub fn open(topic: &Topic, options: &SubscriberOptions) -> Result<Subscriber, Error> {
        Subscriber::open_as(Part::Reader, topic, options)
    }

    pub(crate) fn open_as(
        part: Part,
        topic: &Topic,
        options: &SubscriberOptions,
    ) -> Result<Subscriber, Error> {
        let waker = Waker::new().map_err(Error::os("eventfd", topic.path()))?;
        let mut subscriber = Subscriber {
            topic: topic.clone(),
            part,
            guard: options.guard,
            policy: options.policy,
            tie: Tie::Awaiting {
                watch: None,
                past: Past::default(),
            },
            waker,
            publisher_up: false,
            pending: None,
            next_look: Instant::now(),
            past: Stats::default(),
            owner: Owner::here(),
            nap: SHORTEST_NAP,
        };
        match Attachment::open(topic, part, options.guard, Beginning::At(options.start))? {
            Some(attachment) => subscriber.hold(attachment)?,
            None => subscriber.await_topic(Past::default()),
        }
        subscriber.pending = None;
        Ok(subscriber)
    }

    /// Takes the next message, if there is one, into `buffer`, whose content it replaces. Never waits.
    ///
    /// # Errors
    /// When the topic is to be attached to again: as [`Subscriber::open`]. The next call tries again.
    #[inline]
    pub fn try_read(&mut self, buffer: &mut Vec<u8>) -> Result<Read, Error> {
        let mut sink = IntoVec::new(buffer);
        Ok(
            match self.step(|it, topic, policy| it.next(topic, policy, &mut sink))? {
                Step::Message(meta) => {
                    // SAFETY: the sink gave room for `len` bytes, and all of them were copied there.
                    unsafe { sink.finish(meta.len) };
                    Read::Message(meta)
                }
                Step::Change(Change::Up) => Read::PublisherUp,
                Step::Change(Change::Down) => Read::PublisherDown,
                Step::Nothing => Read::Nothing,
            },
        )
    }

    /// Takes the next message, if there is one, into a buffer that `alloc` makes for its length. `alloc` may be called
    /// more than once, when the publisher overtakes the copy.
    ///
    /// # Errors
    /// As [`Subscriber::try_read`].
    ///
    /// # Panics
    /// When the buffer is not as long as was asked for.
    #[inline]
    pub fn try_read_with<B: AsMut<[u8]>>(
        &mut self,
        alloc: impl FnMut(usize) -> B,
    ) -> Result<Received<B>, Error> {
        let mut sink = IntoNew::new(alloc);
        let step = self.step(|it, topic, policy| it.next(topic, policy, &mut sink))?;
        Ok(match (step, sink.into_buffer()) {
            (Step::Message(meta), Some(buffer)) => Received::Message(meta, buffer),
            (Step::Change(Change::Up), _) => Received::PublisherUp,
            (Step::Change(Change::Down), _) => Received::PublisherDown,
            _ => Received::Nothing,
        })
    }

    /// Takes the next message, if there is one, without copying it: see [`Lease`]. Never waits.
    ///
    /// # Errors
    /// [`Error::TooManyLeases`] when three are held; the message is kept. [`Error::Os`] when it cannot be mapped. Else as
    /// [`Subscriber::try_read`].
    pub fn try_lease(&mut self) -> Result<Received<Lease>, Error> {
        let step = self.step(Attachment::lease)?;
        Ok(match step {
            Step::Message(lease) => Received::Message(lease.meta(), lease),
            Step::Change(Change::Up) => Received::PublisherUp,
            Step::Change(Change::Down) => Received::PublisherDown,
            Step::Nothing => Received::Nothing,
        })
    }

    /// Sleeps until [`Subscriber::try_read`] has something to say, a [`Waker`] is used or the time is up.
    ///
    /// # Errors
    /// As [`Subscriber::try_read`].
    pub fn wait(&mut self, timeout: Duration) -> Result<Wait, Error> {
        self.check_owner()?;
        let deadline = Instant::now().checked_add(timeout);
        loop {
            if self.waker.take() {
                return Ok(Wait::Woken);
            }
            if self.publisher_up && self.has_news() {
                return Ok(Wait::Ready);
            }
            self.look_around()?;
            if self.pending.is_some() || self.has_news() {
                return Ok(Wait::Ready);
            }
            let now = Instant::now();
            let left = deadline.map_or(LONGEST_SLEEP, |deadline| {
                deadline.saturating_duration_since(now)
            });
            if left.is_zero() {
                return Ok(Wait::TimedOut);
            }
            self.sleep(left.min(self.longest_sleep()));
        }
    }

    /// Waits for the next message or change of the publisher and takes it. [`Read::Nothing`] when the time is up or a
    /// [`Waker`] was used.
    ///
    /// # Errors
    /// As [`Subscriber::try_read`].
    pub fn read_timeout(&mut self, buffer: &mut Vec<u8>, timeout: Duration) -> Result<Read, Error> {
        let deadline = Instant::now().checked_add(timeout);
        loop {
            let read = self.try_read(buffer)?;
            if read != Read::Nothing {
                return Ok(read);
            }
            let left = deadline.map_or(Duration::MAX, |deadline| {
                deadline.saturating_duration_since(Instant::now())
            });
            if self.wait(left)? != Wait::Ready {
                return Ok(Read::Nothing);
            }
        }
    }

    /// Which messages to get from now on after falling behind.
    pub fn set_policy(&mut self, policy: Policy) {
        self.policy = policy;
    }

    /// A handle for waking this subscriber from another thread.
    pub fn waker(&self) -> Waker {
        self.waker.clone()
    }

    /// The topic.
    pub fn topic(&self) -> &Topic {
        &self.topic
    }

    /// Whether the topic had a live publisher when last looked at.
    pub fn publisher_up(&self) -> bool {
        self.publisher_up
    }

    /// Number and length of the slots, once there is a segment.
    pub fn geometry(&self) -> Option<Geometry> {
        self.attachment()
            .map(|attachment| attachment.header().geometry)
    }

    /// The encoding of the messages, once there is a segment.
    pub fn content(&self) -> Option<ContentTag> {
        self.attachment()
            .map(|attachment| attachment.header().content)
    }

    /// Counts of this subscriber's whole life.
    pub fn stats(&self) -> Stats {
        let (lost, resyncs) = match &self.tie {
            Tie::Attached(attachment) => (
                attachment.reader().lost_total(),
                attachment.reader().resyncs(),
            ),
            Tie::Awaiting { past, .. } => (past.lost, 0),
        };
        Stats {
            lost: self.past.lost.saturating_add(lost),
            resyncs: self.past.resyncs.saturating_add(resyncs),
            ..self.past
        }
    }

    /// Which publisher the segment has, or had last, once there is one.
    pub fn incarnation(&self) -> Option<Incarnation> {
        self.attachment().map(Attachment::incarnation)
    }

    fn attachment(&self) -> Option<&Attachment> {
        match &self.tie {
            Tie::Attached(attachment) => Some(attachment),
            Tie::Awaiting { .. } => None,
        }
    }

    /// A child that read on would move the cursor of its parent.
    #[inline]
    fn check_owner(&self) -> Result<(), Error> {
        if self.owner.is_here() {
            return Ok(());
        }
        Err(Error::Forked {
            path: self.topic.path().to_owned(),
        })
    }

    fn longest_sleep(&self) -> Duration {
        self.attachment()
            .map_or(LONGEST_SLEEP, Attachment::longest_sleep)
    }

    fn has_news(&self) -> bool {
        self.attachment().is_some_and(Attachment::has_news)
    }

    #[inline]
    fn step<T>(
        &mut self,
        mut take: impl FnMut(&mut Attachment, &Topic, Policy) -> Result<Option<T>, Error>,
    ) -> Result<Step<T>, Error> {
        self.check_owner()?;
        if self.publisher_up
            && self.pending.is_none()
            && let Some(message) = self.take(&mut take)?
        {
            return Ok(Step::Message(message));
        }
        self.look_around()?;
        Ok(match self.pending.take() {
            Some(change) => Step::Change(change),
            None => self.take(&mut take)?.map_or(Step::Nothing, Step::Message),
        })
    }

    #[inline]
    fn take<T>(
        &mut self,
        take: &mut impl FnMut(&mut Attachment, &Topic, Policy) -> Result<Option<T>, Error>,
    ) -> Result<Option<T>, Error> {
        let Tie::Attached(attachment) = &mut self.tie else {
            return Ok(None);
        };
        let taken = match take(attachment, &self.topic, self.policy) {
            Err(error) if attachment.is_broken() => {
                self.let_go();
                self.tell(false);
                return Err(error);
            }
            taken => taken?,
        };
        if taken.is_some() {
            self.past.delivered += 1;
            self.nap = SHORTEST_NAP;
        }
        Ok(taken)
    }

    /// Looks after the tie: attaches, notices a publisher's end or return. What there is to tell is then pending.
    fn look_around(&mut self) -> Result<(), Error> {
        match &self.tie {
            _ if self.pending.is_some() => Ok(()),
            Tie::Awaiting { past, .. } => {
                let beginning = Beginning::After(*past);
                match Attachment::open(&self.topic, self.part, self.guard, beginning)? {
                    Some(attachment) => self.hold(attachment),
                    None => Ok(()),
                }
            }
            Tie::Attached(attachment) => {
                let due = !attachment.says_live()
                    || !self.publisher_up
                    || Instant::now() >= self.next_look;
                if due {
                    self.look_at_publisher()
                } else {
                    Ok(())
                }
            }
        }
    }

    fn look_at_publisher(&mut self) -> Result<(), Error> {
        self.next_look = Instant::now() + self.longest_sleep();
        let Tie::Attached(attachment) = &mut self.tie else {
            return Ok(());
        };
        let life = attachment
            .life(&self.topic)
            .map_err(Error::os("stat", self.topic.path()))?;
        match life {
            Life::Up => {
                let renewed = attachment.renew_claim(&self.topic);
                if renewed.is_err() {
                    self.let_go();
                }
                self.tell(renewed.is_ok());
                return renewed;
            }
            // What was published before the end comes first.
            Life::Down | Life::Over if attachment.has_news() => {}
            Life::Down => self.tell(false),
            Life::Over => {
                self.let_go();
                self.tell(false);
            }
        }
        Ok(())
    }

    fn tell(&mut self, up: bool) {
        if self.publisher_up != up {
            self.publisher_up = up;
            self.pending = Some(if up { Change::Up } else { Change::Down });
        }
    }

    fn hold(&mut self, attachment: Attachment) -> Result<(), Error> {
        // A waker writes to what its subscriber sleeps on.
        let writable = self.part == Part::Reader;
        self.waker
            .attach(if writable { attachment.alarm() } else { None });
        self.tie = Tie::Attached(attachment);
        self.look_at_publisher()
    }

    fn let_go(&mut self) {
        self.past = self.stats();
        let past = self.attachment().map(Attachment::past).unwrap_or_default();
        // The next reader's count begins with what this one still owes.
        self.past.lost = self.past.lost.saturating_sub(past.lost);
        self.await_topic(past);
    }

    /// Waits for the topic's file. The watch comes first, so that a file made after the look that follows is noticed.
    fn await_topic(&mut self, past: Past) {
        self.waker.attach(None);
        self.tie = Tie::Awaiting {
            watch: Watch::new(directory()).ok(),
            past,
        };
    }

    fn sleep(&mut self, timeout: Duration) {
        match &self.tie {
            Tie::Attached(attachment) => {
                let news =
                    || self.waker.is_woken() || attachment.has_news() || !attachment.says_live();
                if !attachment.is_unmapped() {
                    attachment.sleep(timeout, news);
                } else if !news() {
                    os::wait_for_either(self.waker.event(), None, timeout.min(self.nap));
                    self.nap = (2 * self.nap).min(LONGEST_NAP);
                }
            }
            Tie::Awaiting { watch, .. } => {
                let blind = watch.is_none() || self.topic.path().exists();
                let timeout = if blind {
                    timeout.min(UNWATCHED_SLEEP)
                } else {
                    timeout
                };
                os::wait_for_either(self.waker.event(), watch.as_ref(), timeout);
            }
        }
    }
}

impl Drop for Subscriber {
    fn drop(&mut self) {
        self.waker.attach(None);
    }
}

impl fmt::Debug for Subscriber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Subscriber")
            .field("topic", &self.topic.name())
            .field("publisher_up", &self.publisher_up)
            .field("stats", &self.stats())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::PublisherOptions;
    use crate::publisher::Publisher;

    /// What happens between a look for messages that finds none and a look at the publisher.
    #[test]
    fn what_was_published_in_between_comes_before_the_word_that_the_publisher_is_gone() {
        let ends: [fn(Publisher); 2] = [Publisher::close, Publisher::abandon];
        for end in ends {
            let name = format!("last-words-{}", std::process::id());
            let topic = Topic::new(&name).unwrap();
            let mut publisher = Publisher::open(&topic, &PublisherOptions::default()).unwrap();
            let mut subscriber = Subscriber::open(&topic, &Default::default()).unwrap();
            let mut buffer = Vec::new();
            assert_eq!(subscriber.try_read(&mut buffer).unwrap(), Read::Nothing);
            publisher.publish(b"last").unwrap();
            publisher.publish(b"words").unwrap();
            end(publisher);
            subscriber.look_at_publisher().unwrap();
            for word in [b"last".as_slice(), b"words"] {
                let read = subscriber.try_read(&mut buffer).unwrap();
                assert!(matches!(read, Read::Message(_)), "{read:?}");
                assert_eq!(buffer, word);
            }
            subscriber.look_at_publisher().unwrap();
            let read = subscriber.try_read(&mut buffer).unwrap();
            assert_eq!(read, Read::PublisherDown);
            let _ = std::fs::remove_file(topic.path());
        }
    }
}
