//! The private half of a subscriber: the state machine that follows a topic through the lives of
//! its publishers.
//!
//! ```text
//!                                    open
//!         a segment in state live     │      none
//!             ┌───────────────────────┴───────────────────┐
//!             ▼                                           ▼
//!   ┌───────────────────┐   a live segment appears  ┌───────────┐
//!   │ Attached          │ ◄──────────────────────── │ Awaiting  │
//!   │  publisher up     │        PublisherUp        │           │
//!   └───────────────────┘                           └───────────┘
//!        │         ▲    │                                 ▲   ▲
//!   lock │         │    │  segment over: PublisherDown    │   │
//!   free │         │    └─────────────────────────────────┘   │
//!        ▼         │ lock taken: PublisherUp                  │
//!   ┌───────────────────┐                                     │
//!   │ Attached          │         segment over                │
//!   │  publisher down   │ ────────────────────────────────────┘
//!   └───────────────────┘
//!     PublisherDown
//! ```
//!
//! Changes to "down" and "over" wait until the messages that are left have been delivered. Each
//! change is pending until the caller has received it, and nothing is checked meanwhile, so that
//! an "up" and a "down" never cancel each other out.

use std::time::{Duration, Instant};

use crate::attachment::{Attachment, Beginning, Progress};
use crate::backing::Role;
use crate::delivery::Policy;
use crate::error::Error;
use crate::life::Life;
use crate::options::SubscriberOptions;
use crate::os::{self, Watch};
use crate::outcome::{Stats, Wait};
use crate::owner::Owner;
use crate::topic::{Topic, directory};
use crate::wait::LONGEST_SLEEP;
use crate::waker::Waker;

/// The longest sleep while a file is there that is not yet a segment, or while the directory
/// cannot be watched.
const UNWATCHED_SLEEP: Duration = Duration::from_millis(50);

/// The sleep between two looks at a topic that is not mapped, after a message.
const SHORTEST_NAP: Duration = Duration::from_millis(1);
/// The longest such sleep; each is twice as long as the one before.
const LONGEST_NAP: Duration = Duration::from_millis(4);

/// See the module.
pub(crate) struct Subscription {
    topic: Topic,
    role: Role,
    pub(crate) options: SubscriberOptions,
    connection: Connection,
    waker: Waker,
    publisher_up: bool,
    /// A change that the caller has not received yet.
    pending: Option<Change>,
    next_check: Instant,
    /// Counts of the segments before this one, and all deliveries.
    earlier: Stats,
    owner: Owner,
    /// How long the next sleep is on a topic that is not mapped.
    nap: Duration,
}

/// The topic's segment, or the wait for one.
enum Connection {
    Attached(Attachment),
    Awaiting {
        /// `None` when the directory cannot be watched.
        watch: Option<Watch>,
        progress: Progress,
    },
}

/// A change of the publisher.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Change {
    Up,
    Down,
}

/// What a step gave, before it is put into the caller's type.
pub(crate) enum Step<T> {
    Message(T),
    Change(Change),
    Nothing,
}

impl Subscription {
    pub(crate) fn open(
        role: Role,
        topic: &Topic,
        options: &SubscriberOptions,
    ) -> Result<Subscription, Error> {
        let waker = Waker::new().map_err(Error::os("eventfd", topic.path()))?;
        let mut subscription = Subscription {
            topic: topic.clone(),
            role,
            options: *options,
            connection: Connection::Awaiting {
                watch: None,
                progress: Progress::default(),
            },
            waker,
            publisher_up: false,
            pending: None,
            next_check: Instant::now(),
            earlier: Stats::default(),
            owner: Owner::here(),
            nap: SHORTEST_NAP,
        };
        match Attachment::open(topic, role, options.guard, Beginning::At(options.start))? {
            Some(attachment) => subscription.attach(attachment)?,
            None => subscription.await_topic(Progress::default()),
        }
        // The caller asks with publisher_up; only later changes are reported.
        subscription.pending = None;
        Ok(subscription)
    }

    /// Takes the next message by `take`, or the next change.
    #[inline]
    pub(crate) fn step<T>(
        &mut self,
        mut take: impl FnMut(&mut Attachment, &Topic, Policy) -> Result<Option<T>, Error>,
    ) -> Result<Step<T>, Error> {
        self.check_owner()?;
        if self.publisher_up
            && self.pending.is_none()
            && let Some(message) = self.take_message(&mut take)?
        {
            return Ok(Step::Message(message));
        }
        self.update()?;
        Ok(match self.pending.take() {
            Some(change) => Step::Change(change),
            None => self
                .take_message(&mut take)?
                .map_or(Step::Nothing, Step::Message),
        })
    }

    #[inline]
    fn take_message<T>(
        &mut self,
        take: &mut impl FnMut(&mut Attachment, &Topic, Policy) -> Result<Option<T>, Error>,
    ) -> Result<Option<T>, Error> {
        let Connection::Attached(attachment) = &mut self.connection else {
            return Ok(None);
        };
        let taken = match take(attachment, &self.topic, self.options.policy) {
            Err(error) if attachment.is_broken() => {
                self.detach();
                self.set_publisher_up(false);
                return Err(error);
            }
            taken => taken?,
        };
        if taken.is_some() {
            self.earlier.delivered += 1;
            self.nap = SHORTEST_NAP;
        }
        Ok(taken)
    }

    /// Sleeps until there is a message or a change, the waker is used or `timeout` has passed.
    pub(crate) fn wait(&mut self, timeout: Duration) -> Result<Wait, Error> {
        self.check_owner()?;
        let deadline = Instant::now().checked_add(timeout);
        loop {
            if self.waker.take() {
                return Ok(Wait::Woken);
            }
            if self.publisher_up && self.has_news() {
                return Ok(Wait::Ready);
            }
            self.update()?;
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

    fn sleep(&mut self, timeout: Duration) {
        match &self.connection {
            Connection::Attached(attachment) => {
                let news =
                    || self.waker.is_woken() || attachment.has_news() || !attachment.says_live();
                if !attachment.is_unmapped() {
                    attachment.sleep(timeout, news);
                } else if !news() {
                    os::wait_for_either(self.waker.event(), None, timeout.min(self.nap));
                    self.nap = (2 * self.nap).min(LONGEST_NAP);
                }
            }
            Connection::Awaiting { watch, .. } => {
                let unwatched = watch.is_none() || self.topic.path().exists();
                let timeout = if unwatched {
                    timeout.min(UNWATCHED_SLEEP)
                } else {
                    timeout
                };
                os::wait_for_either(self.waker.event(), watch.as_ref(), timeout);
            }
        }
    }

    /// Attaches if there is a segment, and checks the publisher when that is due. A change is
    /// pending afterwards.
    fn update(&mut self) -> Result<(), Error> {
        match &self.connection {
            _ if self.pending.is_some() => Ok(()),
            Connection::Awaiting { progress, .. } => {
                let (guard, beginning) = (self.options.guard, Beginning::After(*progress));
                match Attachment::open(&self.topic, self.role, guard, beginning)? {
                    Some(attachment) => self.attach(attachment),
                    None => Ok(()),
                }
            }
            Connection::Attached(attachment) => {
                let due = !attachment.says_live()
                    || !self.publisher_up
                    || Instant::now() >= self.next_check;
                if due { self.check_publisher() } else { Ok(()) }
            }
        }
    }

    /// Checks whether the publisher lives.
    pub(crate) fn check_publisher(&mut self) -> Result<(), Error> {
        self.next_check = Instant::now() + self.longest_sleep();
        let Connection::Attached(attachment) = &mut self.connection else {
            return Ok(());
        };
        let life = attachment
            .life(&self.topic)
            .map_err(Error::os("stat", self.topic.path()))?;
        match life {
            Life::Up => {
                let renewed = attachment.renew_registration(&self.topic);
                if renewed.is_err() {
                    self.detach();
                }
                self.set_publisher_up(renewed.is_ok());
                return renewed;
            }
            // The messages that are left come first.
            Life::Down | Life::Over if attachment.has_news() => {}
            Life::Down => self.set_publisher_up(false),
            Life::Over => {
                self.detach();
                self.set_publisher_up(false);
            }
        }
        Ok(())
    }

    fn set_publisher_up(&mut self, up: bool) {
        if self.publisher_up != up {
            self.publisher_up = up;
            self.pending = Some(if up { Change::Up } else { Change::Down });
        }
    }

    fn attach(&mut self, attachment: Attachment) -> Result<(), Error> {
        // A waker writes to the word that its subscriber sleeps on; an observer may not write.
        let writable = self.role == Role::Reader;
        self.waker
            .attach(if writable { attachment.alarm() } else { None });
        self.connection = Connection::Attached(attachment);
        self.check_publisher()
    }

    fn detach(&mut self) {
        self.earlier = self.stats();
        let progress = self
            .attachment()
            .map(Attachment::progress)
            .unwrap_or_default();
        // The next reader's count begins with the losses that this one has not reported.
        self.earlier.lost = self.earlier.lost.saturating_sub(progress.lost);
        self.await_topic(progress);
    }

    /// Waits for the topic's file. The watch comes first, so that a file that is made after the
    /// next look is noticed.
    fn await_topic(&mut self, progress: Progress) {
        self.waker.attach(None);
        self.connection = Connection::Awaiting {
            watch: Watch::new(directory()).ok(),
            progress,
        };
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

    pub(crate) fn attachment(&self) -> Option<&Attachment> {
        match &self.connection {
            Connection::Attached(attachment) => Some(attachment),
            Connection::Awaiting { .. } => None,
        }
    }

    pub(crate) fn topic(&self) -> &Topic {
        &self.topic
    }

    pub(crate) fn waker(&self) -> &Waker {
        &self.waker
    }

    pub(crate) fn publisher_up(&self) -> bool {
        self.publisher_up
    }

    pub(crate) fn stats(&self) -> Stats {
        let (lost, resyncs) = match &self.connection {
            Connection::Attached(attachment) => (
                attachment.reader().lost_total(),
                attachment.reader().resyncs(),
            ),
            Connection::Awaiting { progress, .. } => (progress.lost, 0),
        };
        Stats {
            lost: self.earlier.lost.saturating_add(lost),
            resyncs: self.earlier.resyncs.saturating_add(resyncs),
            ..self.earlier
        }
    }
}

impl Drop for Subscription {
    fn drop(&mut self) {
        self.waker.attach(None);
    }
}
