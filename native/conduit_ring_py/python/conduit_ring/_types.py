"""Types that the native half and Python share: exceptions, events and the state of a topic."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Optional, Tuple

from . import _encodings


class RingError(Exception):
    """An error of a topic that is not a mistake of the caller. Base of the following classes."""


class PublisherAliveError(RingError):
    """Another publisher of the topic is alive.

    ``pid`` is its process id, or 0 if the publisher has not written it yet.
    """

    def __init__(self, message: str, pid: int = 0) -> None:
        super().__init__(message, pid)
        self.pid = pid

    def __str__(self) -> str:
        return str(self.args[0])


class NoReaderSlotError(RingError):
    """The topic has 16 subscribers already."""


class NoTopicError(RingError):
    """The topic does not exist."""


class BadSegmentError(RingError):
    """The topic's file is not a ring of this version, or a legacy process may still use it."""


class LeaseLimitError(RingError):
    """The subscriber holds three leases already."""


class SlotHeldError(RingError):
    """Leases of subscribers hold all slots. The message was dropped and counted."""


class NameLostError(RingError):
    """The topic's file was removed or replaced and cannot be created again.

    The message says why. Nothing was published; the next call tries again.
    """


class ClosedError(RingError, ValueError):
    """The publisher or subscriber is closed."""


class MessageTooLargeError(ValueError):
    """The message does not fit into a slot. It was dropped and counted."""


class PublisherEvent(enum.Enum):
    """An event of a topic's publisher, from :meth:`Subscriber.next_event`."""

    UP = "up"
    """The topic has a publisher, for the first time or again."""

    DOWN = "down"
    """The publisher died, closed the topic or was replaced. Its messages came before."""


@dataclass(frozen=True)
class ReaderInfo:
    """A claimed reader slot of a topic."""

    index: int
    """Index of the slot, 0 to 15."""
    native: bool
    """Whether it uses the extension; if not, only ``index`` and ``next_sequence`` are valid."""
    alive: bool
    """Whether it is alive. A dead native reader has leaked its slot; the next one reclaims it."""
    waiting: bool
    """Whether it sleeps until a message arrives."""
    pid: int
    """The reader's process id."""
    next_sequence: int
    """Sequence number of the message that it reads next."""
    lost: int
    """The number of messages that it lost."""


@dataclass(frozen=True)
class TopicInfo:
    """The state of a topic at one time."""

    topic: str
    """The topic's name."""
    slot_count: int
    """The number of messages that the ring holds."""
    slot_size: int
    """The size of a slot in bytes, including its 20-byte header."""
    max_message_size: int
    """The largest size of a message in bytes."""
    state: str
    """``live``; ``dead`` (the publisher died, the next one takes over); ``closed``; ``retired``
    (replaced by a topic of another geometry); ``legacy`` (from a publisher without the extension,
    which may be alive or dead); ``unknown`` (an unknown state)."""
    published: int
    """The number of published messages, which is the next sequence number."""
    content: int
    """The tag of the messages' encoding, 0 for raw bytes; see :func:`content_tag`."""
    epoch: int
    """The number of takeovers after a publisher's death."""
    instance_id: int
    """Random number of this file; 0 without the extension."""
    writer_pid: int
    """The publisher's process id."""
    last_publish_ns: int
    """The time of the last message by the clock of :func:`now_ns`; 0 before the first."""
    realtime_offset_ns: int
    """The difference from a timestamp to wall time at the publisher's start."""
    dropped_pinned: int
    """Skipped sequence numbers and dropped messages due to held slots."""
    rejected_oversize: int
    """Messages that were too large."""
    wake_count: int
    """How often the publisher woke sleeping readers."""
    readers: Tuple[ReaderInfo, ...]
    """The claimed reader slots."""

    @property
    def encoding(self) -> Optional[str]:
        """The name of the encoding ``content`` if the robot's programs use it."""
        return _encodings.name_of(self.content)
