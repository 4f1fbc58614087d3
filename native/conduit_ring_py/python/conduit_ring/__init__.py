"""Shared-memory topics between processes of one machine: one publisher, up to 16 subscribers, any language.

A topic is a ring of message slots in ``/dev/shm``. Its publisher copies a message into the next slot and goes on; it never
waits. Each subscriber copies messages out at its own pace; one that falls behind by more than the ring holds loses the
oldest, and each message says how many were lost before it.

>>> from conduit_ring import Publisher, Subscriber
>>> publisher = Publisher("doc.greetings")
>>> subscriber = Subscriber("doc.greetings")        # in this process or another, before or after
>>> publisher.publish(b"hello")
0
>>> message = subscriber.recv(timeout=1.0)
>>> message.sequence, bytes(message)
(0, b'hello')
>>> publisher.close(); subscriber.close()

What is guaranteed:

- A message is delivered whole or not at all.
- A publisher that is killed is succeeded where it left off, and a killed subscriber's place is taken back. Nothing has to
  be cleaned up, whoever dies at whatever instant.
- A subscriber learns within half a second that its publisher died, and goes on with the next one by itself.

When not to use it: when every message must arrive, between machines, or between users who do not trust each other. After
``os.fork`` (and so with multiprocessing's start method "fork") a child opens its own: its parent's publishers and
subscribers raise ``RuntimeError`` there. Prefer the start methods "spawn" and "forkserver": a child that was forked without
``exec`` keeps its dead parent's topics locked.
"""

import os as _os

from . import _native
from ._native import (
    Lease,
    Loan,
    Message,
    Publisher,
    Subscriber,
    content_tag,
    info,
    now_ns,
    realtime_offset_ns,
    topics,
)
from ._types import (
    BadSegmentError,
    ClosedError,
    LeaseLimitError,
    MessageTooLargeError,
    NameLostError,
    NoReaderSlotError,
    NoTopicError,
    PublisherAliveError,
    PublisherEvent,
    ReaderInfo,
    RingError,
    SlotHeldError,
    TopicInfo,
)

_os.register_at_fork(after_in_child=_native._after_fork)

__all__ = [
    "BadSegmentError",
    "ClosedError",
    "Lease",
    "LeaseLimitError",
    "Loan",
    "Message",
    "MessageTooLargeError",
    "NameLostError",
    "NoReaderSlotError",
    "NoTopicError",
    "Publisher",
    "PublisherAliveError",
    "PublisherEvent",
    "ReaderInfo",
    "RingError",
    "SlotHeldError",
    "Subscriber",
    "TopicInfo",
    "content_tag",
    "info",
    "now_ns",
    "realtime_offset_ns",
    "topics",
]
