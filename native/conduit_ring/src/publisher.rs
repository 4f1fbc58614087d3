//! The one publisher of a topic.

use std::fmt;

use crate::error::Error;
use crate::geometry::Geometry;
use crate::info::Info;
use crate::loan::{Loan, SuspendedLoan};
use crate::options::PublisherOptions;
use crate::publication::Publication;
use crate::publish_error::PublishError;
use crate::topic::Topic;

/// The one publisher of a topic.
///
/// Publishing copies a message into the next slot and returns. It never waits for a subscriber,
/// and calls the operating system only when a subscriber sleeps.
///
/// A topic has one publisher at a time. Its life is a lock that the kernel frees, so that a
/// publisher that is killed at any instant leaves a topic that the next [`Publisher::open`] takes
/// over.
///
/// | the publisher | the file | subscribers | the next publisher |
/// |---|---|---|---|
/// | is dropped, or calls [`close`](Publisher::close) | removed | read the rest, then [`PublisherDown`] | makes a new file and counts from 0 |
/// | calls [`abandon`](Publisher::abandon), or is killed | stays | read the rest, then [`PublisherDown`] | takes the file over at the same number |
/// | loses the file's name | made anew, with its messages | follow, and lose nothing that is in the ring | |
///
/// ```
/// use conduit_ring::{Publisher, PublisherOptions, Topic};
///
/// # let name = format!("doc-publisher-{}", std::process::id());
/// let topic = Topic::new(&name)?;
/// let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// assert_eq!(publisher.publish(b"12.5 degrees")?, 0);
/// assert_eq!(publisher.publish_slices(&[b"head", b"body"])?, 1);
///
/// // A publisher that dies is succeeded at the same sequence number.
/// publisher.abandon();
/// let publisher = Publisher::open(&topic, &PublisherOptions::default())?;
/// assert_eq!((publisher.next_sequence(), publisher.info().epoch), (2, 1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// [`PublisherDown`]: crate::Read::PublisherDown
pub struct Publisher {
    publication: Publication,
    abandoned: bool,
}

impl Publisher {
    /// Makes the topic, or takes it over from a publisher that died.
    ///
    /// A topic with the same geometry and content is continued in place: at the same sequence
    /// number, and without its subscribers noticing. With another geometry or content the old
    /// segment is retired and a new one is made, which subscribers follow.
    ///
    /// # Errors
    /// - [`Error::InvalidTopic`] for a name that [`Topic::new`] refuses.
    /// - [`Error::PublisherAlive`] while another publisher of the topic lives.
    /// - [`Error::ForeignOwner`] when the file belongs to a user who is not
    ///   [trusted](crate::trust), [`Error::InvalidTrust`] when the list of those is invalid.
    /// - [`Error::LegacyInUse`] or [`Error::BadSegment`] when the file is not a ring of this
    ///   crate and a process may use it (see [`PublisherOptions::force`]).
    /// - [`Error::Os`] when the operating system refuses, for example because `/dev/shm` is full.
    pub fn open(topic: &Topic, options: &PublisherOptions) -> Result<Publisher, Error> {
        Ok(Publisher {
            publication: Publication::open(topic, options)?,
            abandoned: false,
        })
    }

    /// Publishes one message and returns its sequence number.
    ///
    /// Never waits. Calls the operating system only when a subscriber sleeps.
    ///
    /// # Errors
    /// Nothing was published after any of these:
    /// - [`PublishError::TooLarge`] when the message does not fit a slot. It is counted.
    /// - [`PublishError::SlotHeld`] while leases of subscribers hold all slots. It is counted. A
    ///   single held slot is no error: it is passed over, and its number with it.
    /// - [`PublishError::NameLost`] while the file's name is lost and cannot be got back; see
    ///   [`Publisher::look_after`].
    /// - [`PublishError::Forked`] in a child of the process that opened the publisher.
    #[inline]
    pub fn publish(&mut self, message: &[u8]) -> Result<u64, PublishError> {
        self.publish_slices(&[message])
    }

    /// Publishes the concatenation of `parts` as one message. Each part is copied straight into
    /// the slot.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    #[inline]
    pub fn publish_slices(&mut self, parts: &[&[u8]]) -> Result<u64, PublishError> {
        self.publication.publish(parts)
    }

    /// Lends the next slot, for a message of `len` bytes that is written there piece by piece.
    ///
    /// The message needs no copy elsewhere. Nothing is published before [`Loan::commit`]. From
    /// the loan on, the oldest message, which was in the slot, is lost to readers who have not
    /// read it.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    pub fn loan(&mut self, len: usize) -> Result<Loan<'_>, PublishError> {
        self.publication.begin(len)?;
        Ok(Loan::new(&mut self.publication, len))
    }

    /// Checks whether the topic's name still leads to this publisher's file, and makes the file
    /// anew if it does not.
    ///
    /// The new file has the same messages and continues at the same sequence number, and the
    /// subscribers follow. Publishing checks by itself, at most four times a second. Call this in
    /// a publisher that may be silent for longer and must be found all the same;
    /// [`upkeep`](crate::upkeep) does so from a thread.
    ///
    /// # Errors
    /// - [`PublishError::NameLost`] when the name belongs to another living publisher or to a
    ///   stranger, or when memory is short; [`Publisher::trouble`] says which. Nothing is
    ///   published until the name is got back; each check tries again.
    /// - [`PublishError::Forked`] in a child of the process that opened the publisher.
    pub fn look_after(&mut self) -> Result<(), PublishError> {
        self.publication.look_after()
    }

    /// Returns why the topic's name is lost, while it is.
    pub fn trouble(&self) -> Option<&Error> {
        self.publication.trouble()
    }

    /// Returns how many times this publisher had to make its file anew.
    pub fn renewals(&self) -> u64 {
        self.publication.renewals()
    }

    /// Returns the topic.
    pub fn topic(&self) -> &Topic {
        self.publication.topic()
    }

    /// Returns number and length of the slots.
    pub fn geometry(&self) -> Geometry {
        self.publication.geometry()
    }

    /// Returns the sequence number of the next message.
    pub fn next_sequence(&self) -> u64 {
        self.publication.next_sequence()
    }

    /// Returns the state of the topic, its counters and its readers, as they are now.
    pub fn info(&self) -> Info {
        let attached = self.publication.attached();
        Info::collect(
            self.topic(),
            &attached.segment,
            &attached.header,
            &*attached.memory,
            true,
        )
    }

    /// Ends the topic. Subscribers read the messages that are left, and then
    /// [`PublisherDown`](crate::Read::PublisherDown).
    ///
    /// Dropping the publisher does the same.
    pub fn close(self) {}

    /// Lets the topic go as a death would: the file stays, and the next publisher takes it over.
    pub fn abandon(mut self) {
        self.abandoned = true;
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.publication.end(self.abandoned);
    }
}

impl SuspendedLoan {
    /// Returns the loan as it was. Returns `None` when the publisher has published meanwhile, or
    /// is not the one that lent.
    pub fn resume<'a>(&self, publisher: &'a mut Publisher) -> Option<Loan<'a>> {
        self.resume_on(&mut publisher.publication)
    }
}

impl fmt::Debug for Publisher {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Publisher")
            .field("topic", &self.topic().name())
            .field("geometry", &self.geometry())
            .field("next_sequence", &self.next_sequence())
            .finish_non_exhaustive()
    }
}
