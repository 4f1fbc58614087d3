//! Where each field lies in a segment, and the fixed values of the fields.
//!
//! Offsets 0..16, 64..72, 128..136 and the first eight bytes of each reader slot are conduit's,
//! and mean what its C++ programs take them to mean. All other header bytes are spare there and
//! hold the extension. docs/wire-format.md has the same tables with the meaning of each field; a
//! test compares the two.

/// Length of the header in front of slot 0.
pub(crate) const HEADER_LEN: usize = 1216;
/// Number of reader slots, and the only value of `max_subscribers` that is accepted.
pub(crate) const READERS: u32 = 16;
/// Length of the header of one slot: size, sequence, timestamp.
pub(crate) const SLOT_HEADER_LEN: usize = 20;

/// The bytes "GNGR" in `ext_magic`: the segment has the extension.
pub(crate) const EXT_MAGIC: u32 = u32::from_le_bytes(*b"GNGR");
/// A segment with another major version is refused.
pub(crate) const VERSION_MAJOR: u16 = 1;
/// Counts additions that an older reader may ignore.
pub(crate) const VERSION_MINOR: u16 = 0;
/// Feature bits that a reader must know to read at all. None is defined yet.
pub(crate) const REQUIRED_FEATURES: u32 = 0xFFFF_0000;

/// A publisher publishes, or died and may be succeeded.
pub(crate) const STATE_LIVE: u32 = 1;
/// The publisher ended the topic.
pub(crate) const STATE_CLOSED: u32 = 2;
/// A successor uses another file.
pub(crate) const STATE_RETIRED: u32 = 3;

/// `seq_hi` of a slot that is being written.
pub(crate) const POISON: u32 = 0xFFFF_FFFF;

/// The time in a slot whose number was used up without a message. Its length is 0. An empty
/// message has a time.
pub(crate) const NO_MESSAGE: u64 = 0;

/// Offset of an aligned 32-bit header word. It exists only for offsets inside the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct At32(u16);

/// Offset of an aligned 64-bit header word. It exists only for offsets inside the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct At64(u16);

impl At32 {
    const fn new(offset: usize) -> Self {
        assert!(offset.is_multiple_of(4) && offset + 4 <= HEADER_LEN);
        At32(offset as u16)
    }

    pub(crate) const fn offset(self) -> usize {
        self.0 as usize
    }
}

impl At64 {
    const fn new(offset: usize) -> Self {
        assert!(offset.is_multiple_of(8) && offset + 8 <= HEADER_LEN);
        At64(offset as u16)
    }

    pub(crate) const fn offset(self) -> usize {
        self.0 as usize
    }
}

pub(crate) const SLOT_COUNT: At32 = At32::new(0);
pub(crate) const SLOT_SIZE: At32 = At32::new(4);
pub(crate) const MAX_SUBSCRIBERS: At32 = At32::new(8);
pub(crate) const MAGIC: At32 = At32::new(16);
pub(crate) const VERSION: At32 = At32::new(20);
pub(crate) const FEATURES: At32 = At32::new(24);
pub(crate) const STATE: At32 = At32::new(28);
pub(crate) const INSTANCE_ID: At64 = At64::new(32);
pub(crate) const REALTIME_OFFSET: At64 = At64::new(40);
pub(crate) const CONTENT_TAG: At64 = At64::new(48);
pub(crate) const WRITER_EPOCH: At32 = At32::new(56);
pub(crate) const CHECKSUM: At32 = At32::new(60);
pub(crate) const WRITE_IDX: At64 = At64::new(64);
pub(crate) const WRITE_INTENT: At64 = At64::new(72);
pub(crate) const WRITER_PID: At32 = At32::new(80);
/// The longest message that the publisher accepts, where that is less than a slot holds; else 0.
pub(crate) const MESSAGE_LIMIT: At32 = At32::new(84);
pub(crate) const WRITER_START: At64 = At64::new(88);
pub(crate) const LAST_PUBLISH: At64 = At64::new(96);
pub(crate) const DROPPED_PINNED: At64 = At64::new(104);
pub(crate) const REJECTED_OVERSIZE: At64 = At64::new(112);
pub(crate) const SUBSCRIBER_MASK: At32 = At32::new(128);
pub(crate) const FUTEX_WORD: At32 = At32::new(132);
pub(crate) const NATIVE_MASK: At32 = At32::new(136);
pub(crate) const WAITING_MASK: At32 = At32::new(140);
pub(crate) const PIN_MASK: At32 = At32::new(144);
pub(crate) const WAKE_COUNT: At64 = At64::new(152);

/// The byte whose lock says that a publisher lives.
pub(crate) const PUBLISHER_LOCK: u64 = WRITE_IDX.offset() as u64;

/// Offsets inside a slot. All words have 32 bits, because the sequence is not 8-aligned.
pub(crate) const SLOT_LEN: usize = 0;
pub(crate) const SLOT_SEQ_LO: usize = 4;
pub(crate) const SLOT_SEQ_HI: usize = 8;
pub(crate) const SLOT_TIME_LO: usize = 12;
pub(crate) const SLOT_TIME_HI: usize = 16;

/// The number of one of the 16 reader slots, and the places of its fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ReaderSlot(u16);

impl ReaderSlot {
    /// Returns all reader slots. The loom model has two.
    pub(crate) fn all() -> impl Iterator<Item = ReaderSlot> {
        (0..if cfg!(loom) { 2 } else { READERS as u16 }).map(ReaderSlot)
    }

    pub(crate) const fn index(self) -> u32 {
        self.0 as u32
    }

    /// Returns the bit in the masks.
    pub(crate) const fn bit(self) -> u32 {
        1 << self.0
    }

    const fn base(self) -> usize {
        192 + 64 * self.0 as usize
    }

    /// Returns the byte whose lock says that the reader in this slot lives.
    pub(crate) const fn lock(self) -> u64 {
        self.base() as u64
    }

    pub(crate) const fn read_idx(self) -> At64 {
        At64::new(self.base())
    }

    pub(crate) const fn pid(self) -> At32 {
        At32::new(self.base() + 8)
    }

    pub(crate) const fn start_time(self) -> At64 {
        At64::new(self.base() + 16)
    }

    pub(crate) const fn lost_count(self) -> At64 {
        At64::new(self.base() + 24)
    }

    pub(crate) const fn claim_id(self) -> At64 {
        At64::new(self.base() + 32)
    }

    /// Returns the three pins of this reader slot. A pin is the sequence number + 1 of a message
    /// whose slot the reader holds, or 0.
    pub(crate) const fn pins(self) -> [At64; 3] {
        [
            At64::new(self.base() + 40),
            At64::new(self.base() + 48),
            At64::new(self.base() + 56),
        ]
    }
}
