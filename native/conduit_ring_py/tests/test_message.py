import struct

import numpy
import pytest

from conduit_ring import Message, Publisher, Subscriber

IMU = numpy.dtype([("timestamp", "<f8"), ("accel", "<f4", 3), ("gyro", "<f4", 3)])


@pytest.fixture
def exchange(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:

        def exchange(data):
            publisher.publish(data)
            return subscriber.recv(timeout=0)

        yield exchange


def test_a_message_is_a_read_only_buffer(exchange):
    message = exchange(b"\1\2\3\4")
    assert isinstance(message, Message)
    assert bytes(message) == message.tobytes() == b"\1\2\3\4"
    assert message.data == b"\1\2\3\4"
    assert message.data.readonly
    assert (len(message), struct.unpack_from("<I", message)) == (4, (0x04030201,))
    with pytest.raises(TypeError):
        message.data[0] = 1


def test_an_empty_message_is_a_message(exchange):
    message = exchange(b"")
    assert message
    assert (len(message), bytes(message), message.array().shape) == (0, b"", (0,))


def test_a_message_says_what_it_is(exchange):
    message = exchange(b"abc")
    stamp = message.timestamp_ns
    assert repr(message) == f"<Message sequence=0 of 3 bytes, timestamp_ns={stamp}, lost=0>"
    with pytest.raises(AttributeError):
        message.sequence = 1
    with pytest.raises(TypeError):
        Message()


def test_views_outlive_the_message_and_the_subscriber(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        publisher.publish(b"kept")
        message = subscriber.recv(timeout=0)
        view, array = message.data, message.array()
        del message
        for _ in range(100):
            publisher.publish(b"other")
            subscriber.recv(timeout=0)
    assert view == b"kept"
    assert array.tobytes() == b"kept"


def test_an_array_has_the_type_and_shape_that_were_asked_for(exchange):
    numbers = numpy.arange(24, dtype="<f4")
    message = exchange(numbers)
    assert numpy.array_equal(message.array("<f4"), numbers)
    assert numpy.array_equal(message.array(numpy.float32, (2, 3, 4)), numbers.reshape(2, 3, 4))
    assert numpy.array_equal(message.array("<f4", (-1, 3)), numbers.reshape(8, 3))
    assert numpy.array_equal(message.array("<f4", 22, offset=8), numbers[2:])
    assert message.array().dtype == numpy.uint8
    assert message.array(shape=(96,)).shape == (96,)


def test_an_array_is_a_read_only_view(exchange):
    message = exchange(b"12345678")
    array = message.array("<u2")
    assert not array.flags.writeable
    assert numpy.shares_memory(array, numpy.frombuffer(message, numpy.uint8))
    with pytest.raises(ValueError):
        array[0] = 1


def test_a_struct_of_other_languages_is_a_structured_array(exchange):
    sent = numpy.array([(12.5, (1, 2, 3), (4, 5, 6))], dtype=IMU)
    received = exchange(sent).array(IMU)
    assert received["timestamp"] == 12.5
    assert received["gyro"].tolist() == [[4, 5, 6]]


@pytest.mark.parametrize(
    "dtype, shape, offset",
    [
        ("<f4", None, 0),
        ("u1", (3, 4), 0),
        ("u1", (-1, 3), 0),
        ("u1", None, 11),
        ("O", None, 0),
        ("V0", None, 0),
    ],
)
def test_bytes_that_do_not_fit_are_refused(exchange, dtype, shape, offset):
    message = exchange(bytes(10))
    with pytest.raises(ValueError):
        message.array(dtype, shape, offset=offset)


def test_a_type_that_does_not_exist_is_refused(exchange):
    message = exchange(bytes(8))
    with pytest.raises(TypeError):
        message.array("no such type")
    with pytest.raises(OverflowError):
        message.array("u1", offset=-1)
