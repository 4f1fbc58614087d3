"""Compares the package with docs/wire-format.md."""

import pytest

from conduit_ring import Publisher, Subscriber, content_tag, info
from wire_format import vector

VARIES = [(32, 48), (80, 84), (88, 104), (1228, 1236), (1292, 1300)]
"""The bytes in which two files of the same content differ, according to the dumps."""


@pytest.fixture
def file(topic):
    return f"/dev/shm/conduit_{topic}"


def without_what_varies(segment):
    segment = bytearray(segment)
    for start, end in VARIES:
        segment[start:end] = bytes(end - start)
    return bytes(segment)


def test_a_publisher_makes_the_segment_that_the_page_shows(topic, file):
    def segment():
        with open(file, "rb") as opened:
            return without_what_varies(opened.read())

    with Publisher(topic, slot_count=2, slot_size=64, content="text/plain") as publisher:
        assert segment() == without_what_varies(vector("empty_segment"))
        for n in range(3):
            publisher.publish(b"message%d" % n)
        assert segment() == without_what_varies(vector("segment"))


def test_a_subscriber_reads_the_segment_that_the_page_shows(topic, file):
    with open(file, "wb") as opened:
        opened.write(vector("segment"))
    with Subscriber(topic, start=("history", 16)) as subscriber:
        for n in [1, 2]:
            message = subscriber.recv(timeout=0)
            assert (message.sequence, message.data) == (n, b"message%d" % n)
            assert message.timestamp_ns == 1_234_567_890_123_456_787 + n


def test_what_there_is_to_know_of_a_segment_is_as_the_page_says(topic, file):
    with open(file, "wb") as opened:
        opened.write(vector("segment"))
    seen = info(topic)
    assert (seen.slot_count, seen.slot_size) == (2, 64)
    assert (seen.state, seen.published, seen.epoch) == ("dead", 3, 0)
    assert seen.content == content_tag("text/plain")
    assert seen.instance_id == 0x0123456789ABCDEF
    assert (seen.writer_pid, seen.last_publish_ns) == (12345, 1_234_567_890_123_456_789)
    assert seen.realtime_offset_ns == 0x171B37A1AA324000
