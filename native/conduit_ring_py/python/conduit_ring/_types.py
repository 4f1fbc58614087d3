"""What the native half and Python share: exceptions, events, what there is to know about a topic."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Optional, Tuple

from . import _encodings


class RingError(Exception):
    """What can go wrong with a topic that is not the caller's mistake. Base of the ones below."""


class PublisherAliveError(RingError):
    """Another publisher of the topic lives. ``pid`` is its process, as it wrote it there; 0 when it has not yet."""

    def __init__(self, message: str, pid: int = 0) -> None:
        super().__init__(message, pid)
        self.pid = pid

    def __str__(self) -> str:
        return str(self.args[0])


class NoReaderSlotError(RingError):
    """All 16 reader slots of the topic are taken."""


class NoTopicError(RingError):
    """There is no topic of this name."""


class BadSegmentError(RingError):
    """The topic's file is not one that this version can use, or a process without the extension may still use it."""


class LeaseLimitError(RingError):
    """Three leases of the subscriber are held already."""


class SlotHeldError(RingError):
    """Subscribers' leases hold messages in all slots. This one was dropped and counted."""


class NameLostError(RingError):
    """The topic's file was removed or replaced, and cannot be made anew: the message says why. Nothing was published, and it
    is tried again."""


class ClosedError(RingError, ValueError):
    """The publisher or subscriber is closed."""


class MessageTooLargeError(ValueError):
    """The message does not fit into a slot. It is counted, and nothing was published."""


class PublisherEvent(enum.Enum):
    """What a topic's publisher did, as :meth:`Subscriber.next_event` tells it."""

    UP = "up"
    """The topic has a publisher again, or for the first time."""

    DOWN = "down"
    """The publisher died, closed the topic or was replaced. What it had published was delivered before."""


@dataclass(frozen=True)
class ReaderInfo:
    """A claimed reader slot of a topic."""

    index: int
    """Number of the slot, 0 to 15."""
    native: bool
    """Whether it speaks the extension; if not, only ``index`` and ``next_sequence`` mean something."""
    alive: bool
    """Whether it lives. A native one that does not has leaked its slot, which the next who needs it takes back."""
    waiting: bool
    """Whether it sleeps."""
    pid: int
    """Its process."""
    next_sequence: int
    """Sequence number of the message that it reads next."""
    lost: int
    """Messages it has lost."""


@dataclass(frozen=True)
class TopicInfo:
    """What there is to know about a topic, at one moment."""

    topic: str
    """Its name."""
    slot_count: int
    """Messages that the ring holds."""
    slot_size: int
    """Length of a slot in bytes, its 20-byte header included."""
    max_message_size: int
    """The longest message that fits, in bytes."""
    state: str
    """``live``; ``dead`` (the publisher died, the next one takes over); ``closed``; ``retired`` (replaced by one of another
    geometry); ``legacy`` (its publisher does not say); ``unknown`` (it says something that it should not)."""
    published: int
    """Messages published so far, which is the next sequence number."""
    content: int
    """The encoding of the messages as a tag, 0 for raw bytes: see :func:`content_tag`."""
    epoch: int
    """Takeovers after a publisher's death."""
    instance_id: int
    """Random number of this very segment; 0 if it has no extension."""
    writer_pid: int
    """The publisher's process."""
    last_publish_ns: int
    """When the last message was published, on :func:`now_ns`'s clock; 0 before the first."""
    realtime_offset_ns: int
    """What to add to a time stamp to get wall time, as of the publisher's start."""
    dropped_pinned: int
    """Messages dropped because a reader held the slot."""
    rejected_oversize: int
    """Messages refused because they were too large."""
    wake_count: int
    """Times that sleepers were called."""
    readers: Tuple[ReaderInfo, ...]
    """The claimed reader slots."""

    @property
    def encoding(self) -> Optional[str]:
        """The name behind ``content``, if it is one that the robot's programs use."""
        return _encodings.name_of(self.content)
