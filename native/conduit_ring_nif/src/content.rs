//! The content that a subscriber expects of its topic.

use conduit_ring::{ContentTag, Subscriber};

/// The expected encoding, and whether a topic without a stated encoding is accepted too.
pub struct Expected {
    content: Option<ContentTag>,
    untagged: bool,
}

impl Expected {
    /// Expects the encoding of this name, or any without a name.
    pub fn new(content: Option<&str>, untagged: bool) -> Self {
        Self {
            content: content.map(ContentTag::of),
            untagged,
        }
    }

    /// Returns the topic's content if it is not the expected one. A topic that does not exist yet
    /// may have any content.
    pub fn unexpected(&self, ring: &Subscriber) -> Option<ContentTag> {
        let found = ring.content()?;
        let expected = self.content?;
        let accepted = found == expected || (self.untagged && found == ContentTag::RAW);
        (!accepted).then_some(found)
    }
}
