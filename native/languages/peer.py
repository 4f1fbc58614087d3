"""usage: peer.py COUNT OWN OTHER...

The peer in Python: README.md says what it does.
"""

import os
import struct
import sys
import threading
import zlib

from conduit_ring import Publisher, Subscriber

SLOTS = 64
WINDOW = 16
LONGEST_BODY = 61_440
LIMIT = 60.0
"""Longer than a pause of any peer: only a failing one waits so long. Seconds."""

_HEAD = struct.Struct("<QII")
_CHECKSUM = struct.Struct("<I")
_HEADER = _HEAD.size + _CHECKSUM.size


def message(topic, n):
    """Message n of a topic."""
    length = (n * 2654435761 & 0xFFFFFFFF) % (LONGEST_BODY + 1)
    word = (n * 0x9E3779B97F4A7C15 & 0xFFFFFFFFFFFFFFFF).to_bytes(8, "little")
    body = (word * (length // 8 + 1))[:length]
    head = _HEAD.pack(n, zlib.crc32(topic.encode()), length)
    return head + _CHECKSUM.pack(zlib.crc32(body, zlib.crc32(head))) + body


class Progress:
    """How many messages of each topic have been read."""

    def __init__(self, topics):
        self._read = dict.fromkeys(topics, 0)
        self._changed = threading.Condition()

    def tell(self, topic, count):
        with self._changed:
            self._read[topic] = count
            self._changed.notify()

    def await_all(self, count):
        with self._changed:
            self._changed.wait_for(lambda: min(self._read.values()) >= count)


def publish(publisher, count, progress):
    for n in range(count):
        progress.await_all(n + 1 - WINDOW)
        publisher.publish(message(publisher.topic, n))


def read(subscriber, count, progress):
    size = 0
    for n in range(count):
        received = subscriber.recv(timeout=LIMIT)
        if received.lost or received.sequence != n or received.data != message(subscriber.topic, n):
            raise ValueError(f"{subscriber.topic}: {received} is not message {n}")
        size += len(received)
        progress.tell(subscriber.topic, n + 1)
    say(f"verified {subscriber.topic} {count} {size}")


def fail(thrown):
    """Ends the process for what a thread has thrown."""
    print(f"python: {thrown.exc_value!r}", file=sys.stderr, flush=True)
    os._exit(1)


def say(line):
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(count, own, *others):
    threading.excepthook = fail
    subscribers = [Subscriber(topic) for topic in others]
    progress = Progress(others)
    with Publisher(own, depth=SLOTS, max_message_size=_HEADER + LONGEST_BODY) as publisher:
        say("ready")
        sys.stdin.readline()
        readers = [threading.Thread(target=read, args=(subscriber, count, progress)) for subscriber in subscribers]
        for reader in readers:
            reader.start()
        publish(publisher, count, progress)
        for reader in readers:
            reader.join()
        sys.stdin.readline()


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
