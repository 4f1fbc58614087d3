"""The peer in Python. See README.md.

Usage: peer.py COUNT OWN OTHER...
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
TIMEOUT = 60.0
"""Longest wait for a message in seconds, longer than any pause of a working peer."""

_HEAD = struct.Struct("<QII")
_CHECKSUM = struct.Struct("<I")
_HEADER = _HEAD.size + _CHECKSUM.size


def message(topic, n):
    """Return message `n` of a topic."""
    length = (n * 2654435761 & 0xFFFFFFFF) % (LONGEST_BODY + 1)
    word = (n * 0x9E3779B97F4A7C15 & 0xFFFFFFFFFFFFFFFF).to_bytes(8, "little")
    body = (word * (length // 8 + 1))[:length]
    head = _HEAD.pack(n, zlib.crc32(topic.encode()), length)
    return head + _CHECKSUM.pack(zlib.crc32(body, zlib.crc32(head))) + body


class Progress:
    """The number of messages read from each topic."""

    def __init__(self, topics):
        self._read = dict.fromkeys(topics, 0)
        self._changed = threading.Condition()

    def set(self, topic, count):
        """Set the number of messages read from a topic."""
        with self._changed:
            self._read[topic] = count
            self._changed.notify()

    def await_all(self, count):
        """Wait until `count` messages of each topic have been read."""
        with self._changed:
            self._changed.wait_for(lambda: min(self._read.values()) >= count)


def publish(publisher, count, progress):
    """Publish all messages, at most `WINDOW` ahead of the other topics."""
    for n in range(count):
        progress.await_all(n + 1 - WINDOW)
        publisher.publish(message(publisher.topic, n))


def read(subscriber, count, progress):
    """Read and check all messages of a topic."""
    size = 0
    for n in range(count):
        received = subscriber.recv(timeout=TIMEOUT)
        is_intact = received.data == message(subscriber.topic, n)
        if received.lost or received.sequence != n or not is_intact:
            raise ValueError(f"{subscriber.topic}: expected message {n}, got: {received}")
        size += len(received)
        progress.set(subscriber.topic, n + 1)
    print_line(f"verified {subscriber.topic} {count} {size}")


def fail(raised):
    """End the process after an exception in a thread."""
    print(f"python: {raised.exc_value!r}", file=sys.stderr, flush=True)
    os._exit(1)


def print_line(line):
    """Print a line and flush it."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(count, own, *others):
    """Run the peer."""
    threading.excepthook = fail
    subscribers = [Subscriber(topic) for topic in others]
    progress = Progress(others)
    with Publisher(own, depth=SLOTS, max_message_size=_HEADER + LONGEST_BODY) as publisher:
        print_line("ready")
        sys.stdin.readline()
        readers = [
            threading.Thread(target=read, args=(subscriber, count, progress))
            for subscriber in subscribers
        ]
        for reader in readers:
            reader.start()
        publish(publisher, count, progress)
        for reader in readers:
            reader.join()
        sys.stdin.readline()


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
