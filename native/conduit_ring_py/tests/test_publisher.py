import array
import ctypes
import threading

import numpy
import pytest

from conduit_ring import (
    ClosedError,
    MessageTooLargeError,
    Publisher,
    PublisherAliveError,
    RingError,
    Subscriber,
    content_tag,
    info,
)


class Imu(ctypes.Structure):
    _fields_ = [("timestamp", ctypes.c_double), ("Orientation", ctypes.c_float * 3)]


def test_messages_count_from_zero(topic):
    with Publisher(topic) as publisher:
        assert [publisher.publish(b"x") for _ in range(3)] == [0, 1, 2]


@pytest.mark.parametrize(
    "message",
    [
        b"bytes",
        b"",
        bytearray(b"bytearray"),
        bytearray(),
        memoryview(b"memoryview")[3:],
        array.array("d", [1.0, -2.5]),
        numpy.arange(12, dtype=numpy.float32).reshape(3, 4),
        numpy.zeros((), dtype="<u4"),
        numpy.zeros((0, 3)),
        numpy.float64(2.5),
        Imu(2.5, (1.0, 2.0, 3.0)),
        numpy.zeros(2, dtype=[("Orientation", "<f8", 4), ("O", "<u1")]),
        numpy.array([(1.5, [1, 2, 3])], dtype=[("timestamp", "<f8"), ("accel", "<f4", 3)]),
    ],
    ids=lambda message: type(message).__name__,
)
def test_anything_with_bytes_can_be_published(topic, message):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        publisher.publish(message)
        received = subscriber.recv(timeout=0)
        assert received.tobytes() == memoryview(message).tobytes()


def test_a_message_can_be_published_again(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        publisher.publish(b"again")
        publisher.publish(subscriber.recv(timeout=0))
        assert bytes(subscriber.recv(timeout=0)) == b"again"


def test_parts_are_joined_to_one_message(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        body = numpy.arange(3, dtype=numpy.uint8)
        assert publisher.publish(b"head", body, bytearray(b"tail")) == 0
        assert bytes(subscriber.recv(timeout=0)) == b"head\0\1\2tail"


@pytest.mark.parametrize(
    "message, kind",
    [("text", "str; encode it first"), (12, "int"), (None, "NoneType"), ([1, 2], "list")],
)
def test_what_has_no_bytes_is_refused_saying_what_it_was(topic, message, kind):
    with Publisher(topic) as publisher:
        for parts in [(message,), (b"head", message)]:
            with pytest.raises(TypeError, match=f"got: {kind}"):
                publisher.publish(*parts)
        assert publisher.info().published == 0


def test_bytes_that_do_not_lie_together_are_refused(topic):
    with Publisher(topic) as publisher:
        matrix = numpy.zeros((4, 4))
        for scattered in [matrix[:, 1], matrix.T[1:], memoryview(b"abcdef")[::2]]:
            with pytest.raises(ValueError, match="numpy.ascontiguousarray"):
                publisher.publish(scattered)
        publisher.publish(numpy.ascontiguousarray(matrix[:, 1]))


def test_an_array_of_python_objects_is_refused(topic):
    with Publisher(topic) as publisher, pytest.raises(TypeError, match="Python objects"):
        publisher.publish(numpy.zeros(2, dtype=[("time", "<f8"), ("name", "O")]))


def test_a_message_that_is_too_large_is_refused_and_counted(topic):
    with Publisher(topic, slot_size=128) as publisher:
        reason = "109 bytes and a slot holds 108"
        with pytest.raises(MessageTooLargeError, match=reason) as caught:
            publisher.publish(bytes(109))
        assert isinstance(caught.value, ValueError)
        with pytest.raises(MessageTooLargeError):
            publisher.publish(bytes(100), bytes(9))
        assert publisher.publish(bytes(108)) == 0
        assert publisher.info().rejected_oversize == 2


def test_the_size_is_said_with_the_slots_header_or_without_it(topic):
    with Publisher(topic) as publisher:
        assert (publisher.slot_count, publisher.max_message_size) == (16, 4076)
    with Publisher(topic, slot_count=4, slot_size=2_100_000) as publisher:
        assert publisher.slot_count == 4
        assert publisher.max_message_size >= 2_100_000 - 20
    with Publisher(topic, depth=5, max_message_size=1000) as publisher:
        assert publisher.slot_count == 8
        assert publisher.max_message_size >= 1000
    with Publisher(topic, depth=32) as publisher:
        assert (publisher.slot_count, publisher.max_message_size) == (32, 4076)


@pytest.mark.parametrize(
    "options",
    [
        {"slot_count": 12},
        {"slot_count": 0},
        {"slot_count": -1},
        {"slot_size": 20},
        {"slot_size": 2**32},
        {"depth": 0},
        {"max_message_size": 2**40},
        {"depth": 4, "slot_size": 100},
    ],
)
def test_an_invalid_size_is_an_error(topic, options):
    with pytest.raises(ValueError, match="accepted|expected"):
        Publisher(topic, **options)


@pytest.mark.parametrize("name", ["", "a/b", "ä", "a b", "x" * 201])
def test_an_invalid_name_is_an_error(name):
    # Other programs may have other rules for names, and these topics can be read.
    for use in [Publisher] if name in ("ä", "a b", "x" * 201) else [Publisher, Subscriber, info]:
        with pytest.raises(ValueError, match="expected a topic name, 1 to 200 of A-Z a-z 0-9 _ . -"):
            use(name)


def test_the_content_is_a_name_a_tag_or_nothing(topic):
    tag = content_tag("sensor_msgs/msg/Imu")
    for content, expected in [(None, 0), ("sensor_msgs/msg/Imu", tag), (tag, tag), (7, 7)]:
        with Publisher(topic, content=content) as publisher:
            assert publisher.info().content == expected
    for wrong in [1.5, -1, 2**64, b"sensor_msgs/msg/Imu"]:
        with pytest.raises(TypeError, match="expected an encoding's name"):
            Publisher(topic, content=wrong)


def test_a_second_publisher_is_refused_saying_who_the_first_is(topic):
    with Publisher(topic) as first:
        with pytest.raises(PublisherAliveError) as caught:
            Publisher(topic)
        assert caught.value.pid == first.info().writer_pid
        assert topic in str(caught.value)
        assert isinstance(caught.value, RingError)


def test_a_closed_publisher_says_that_it_is(topic):
    publisher = Publisher(topic)
    assert not publisher.closed
    publisher.close()
    publisher.close()
    assert publisher.closed
    assert "closed" in repr(publisher)
    for use in [publisher.info, lambda: publisher.publish(b"x")]:
        with pytest.raises(ClosedError, match="publisher is closed"):
            use()


def test_a_block_closes_the_topic_even_when_it_raises(topic):
    with pytest.raises(KeyError), Publisher(topic) as publisher:
        raise KeyError
    assert publisher.closed
    Publisher(topic).close()


def test_a_publisher_says_what_it_is(topic):
    with Publisher(topic, slot_count=4, slot_size=128) as publisher:
        assert publisher.topic == topic
        assert repr(publisher) == f'<Publisher of "{topic}", 4 messages of up to 108 bytes>'


@pytest.mark.parametrize("size", [100, 100_000])
def test_threads_may_share_a_publisher(topic, size):
    large = Publisher(topic, slot_count=512, slot_size=size + 20)
    with large as publisher, Subscriber(topic) as subscriber:
        sequences = [[] for _ in range(4)]

        def publish(n):
            for _ in range(100):
                sequences[n].append(publisher.publish(bytes([n]) * size))

        threads = [threading.Thread(target=publish, args=(n,)) for n in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert sorted(sum(sequences, [])) == list(range(400))
        for expected in range(400):
            message = subscriber.recv(timeout=0)
            assert message.sequence == expected
            assert set(bytes(message)) < {0, 1, 2, 3} and len(set(bytes(message))) == 1


def test_a_full_disk_is_an_oserror(topic):
    with pytest.raises(OSError) as caught:
        Publisher(topic, slot_count=1 << 20, slot_size=1 << 30)
    assert caught.value.errno is not None
    assert topic in str(caught.value)
