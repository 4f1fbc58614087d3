//! Why a message could not be published.

use std::fmt;

/// Why a message was not published.
///
/// Nothing was published, and the next message gets the number that this one would have had. The
/// publisher stays usable, except after [`PublishError::Forked`].
///
/// ```
/// use conduit_ring::{Geometry, PublishError, Publisher, PublisherOptions, Topic};
///
/// # let name = format!("doc-error-{}", std::process::id());
/// let options = PublisherOptions {
///     geometry: Geometry::depth(4, 44)?,
///     ..Default::default()
/// };
/// let mut publisher = Publisher::open(&Topic::new(&name)?, &options)?;
/// let error = publisher.publish(&[0; 45]).unwrap_err();
/// assert_eq!(error, PublishError::TooLarge { len: 45, max: 44 });
/// assert_eq!(error.to_string(), "the message has 45 bytes and a slot holds 44");
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PublishError {
    /// The message does not fit into a slot. It is counted in
    /// [`Info::rejected_oversize`](crate::Info::rejected_oversize), and nothing was written.
    TooLarge {
        /// Length of the message in bytes.
        len: usize,
        /// Length of the longest message that fits.
        max: usize,
    },
    /// [`Lease`](crate::Lease)s of subscribers hold the messages in all slots. The message was
    /// dropped and counted in [`Info::dropped_pinned`](crate::Info::dropped_pinned).
    SlotHeld,
    /// The publisher belongs to the process that forked this one. Open the topic in this process.
    Forked,
    /// The topic's name does not lead to this publisher's file any more, and the file could not
    /// be made anew. [`Publisher::trouble`](crate::Publisher::trouble) says why. The publisher
    /// tries again, at most four times a second.
    NameLost,
}

impl fmt::Display for PublishError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PublishError::TooLarge { len, max } => {
                write!(f, "the message has {len} bytes and a slot holds {max}")
            }
            PublishError::SlotHeld => f.write_str("subscribers hold all slots"),
            PublishError::Forked => {
                f.write_str("the publisher belongs to the process that forked this one")
            }
            PublishError::NameLost => {
                f.write_str("the topic's file was removed and could not be made anew")
            }
        }
    }
}

impl std::error::Error for PublishError {}
