"""Topics in shared memory between processes: one publisher, up to 16 subscribers, any language.

A topic is a ring of message slots in ``/dev/shm``. Its publisher copies a message into the next
slot and never waits. Each subscriber copies messages out at its own pace. A subscriber that falls
behind by more than the ring holds loses the oldest messages, and each message says how many were
lost before it.

>>> from conduit_ring import Publisher, Subscriber
>>> publisher = Publisher("doc.greetings")
>>> subscriber = Subscriber("doc.greetings")        # in this process or another, before or after
>>> publisher.publish(b"hello")
0
>>> message = subscriber.recv(timeout=1.0)
>>> message.sequence, bytes(message)
(0, b'hello')
>>> publisher.close(); subscriber.close()

Guarantees:

- A message is delivered complete or not at all.
- A new publisher takes over the topic of a killed one where it stopped, and a killed subscriber's
  slot is reclaimed. Nothing needs to be cleaned up, whichever process dies at whatever time.
- A subscriber learns within half a second that its publisher died, and continues with the next
  publisher.

Do not use it when every message must arrive, between machines, or between users who do not trust
each other.

After ``os.fork`` (and with multiprocessing's start method "fork"), a child must open its own
publishers and subscribers: those of its parent raise ``RuntimeError`` there. Prefer the start
methods "spawn" and "forkserver": a child that was forked without ``exec`` keeps the topics of its
dead parent locked.
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
