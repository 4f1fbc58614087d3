import dataclasses
import os

import numpy
import pytest

from conduit_ring import Message, Publisher, Subscriber, frames, info, now_ns
from conduit_ring.frames import FrameError, FrameHeader, decode
from conftest import LIMIT
from wire_format import vector

HEADER = FrameHeader(
    width=640,
    height=480,
    fourcc="GREY",
    stride=704,
    data_size=337920,
    timestamp_ns=123456789012345,
    frame_id=4294967295,
    flags=0,
    clock_id=4,
    plane_count=1,
    rotation=2,
    colourspace=3,
    exposure_us=8333,
)


def grey(height, width, /, apart=None, extra=b"", **changes):
    """Return a frame whose pixel (row, column) is row * 10 + column."""
    apart = apart or width
    rows = b"".join(
        bytes(row * 10 + column for column in range(width)).ljust(apart, b"\xee")
        for row in range(height)
    )
    header = FrameHeader(width, height, "GREY", apart, len(rows), timestamp_ns=1, frame_id=2)
    return dataclasses.replace(header, **changes).encode() + rows + extra


def test_the_header_is_that_of_the_test_vector():
    data = vector("frame_header")
    assert FrameHeader.parse(data) == HEADER
    assert HEADER.encode() == data
    assert len(data) == FrameHeader.SIZE == 44


def test_pixels_are_a_view_of_the_message():
    message = grey(3, 4)
    frame = decode(message)
    assert frame.pixels.tolist() == [[0, 1, 2, 3], [10, 11, 12, 13], [20, 21, 22, 23]]
    assert numpy.shares_memory(frame.pixels, numpy.frombuffer(message, numpy.uint8))


def test_rows_may_have_padding_and_bytes_may_follow():
    frame = decode(grey(3, 4, apart=7, extra=b"behind"))
    assert frame.pixels.tolist() == [[0, 1, 2, 3], [10, 11, 12, 13], [20, 21, 22, 23]]
    assert frame.pixels.strides == (7, 1)
    assert len(frame.data) == 21


def test_the_last_row_may_end_with_its_pixels():
    message = grey(2, 4, apart=7, data_size=11)
    assert decode(message).pixels.shape == (2, 4)
    with pytest.raises(FrameError, match="expected 11 bytes of pixels, got: 10"):
        _ = decode(grey(2, 4, apart=7, data_size=10)).pixels


@pytest.mark.parametrize(
    "fourcc, pixels",
    [
        ("GREY", numpy.arange(6, dtype="u1").reshape(2, 3)),
        ("Y16 ", numpy.arange(6, dtype="<u2").reshape(2, 3) * 1000),
        ("RGB3", numpy.arange(18, dtype="u1").reshape(2, 3, 3)),
        ("BGR3", numpy.arange(18, dtype="u1").reshape(2, 3, 3)),
        ("YUYV", numpy.arange(8, dtype="u1").reshape(2, 2, 2)),
        ("UYVY", numpy.arange(8, dtype="u1").reshape(2, 2, 2)),
    ],
)
def test_every_known_format_passes_through_a_topic(topic, fourcc, pixels):
    header = FrameHeader.of(pixels, timestamp_ns=now_ns(), frame_id=9, fourcc=fourcc)
    with Publisher(topic, content=frames.ENCODING) as publisher, Subscriber(topic) as subscriber:
        publisher.publish(header.encode(), pixels)
        frame = decode(subscriber.recv(timeout=0))
    assert frame.header == header
    assert frame.pixels.dtype == pixels.dtype
    assert numpy.array_equal(frame.pixels, pixels)


@pytest.mark.parametrize(
    "fourcc, shape, dtype",
    [
        ("GREY", (2, 3, 3), "u1"),
        ("GREY", (6,), "u1"),
        ("GREY", (2, 3), "u2"),
        ("RGB3", (2, 3), "u1"),
    ],
)
def test_pixels_of_another_format_than_the_headers_are_an_error(fourcc, shape, dtype):
    with pytest.raises(FrameError, match=f"invalid pixels for {fourcc}"):
        FrameHeader.of(numpy.zeros(shape, dtype), timestamp_ns=0, frame_id=0, fourcc=fourcc)


@pytest.mark.parametrize(
    "message, reason",
    [
        (b"CM", "header of 44 bytes, got: 2 bytes"),
        (b"XX" + grey(2, 2)[2:], "starts with"),
        (b"CM\2" + grey(2, 2)[3:], "version 1 .*, got: version 2"),
        (grey(2, 2, width=0), "has no pixels"),
        (grey(2, 2, height=0), "has no pixels"),
        (grey(2, 2, plane_count=0), "impossible number of planes: 0"),
        (grey(2, 2, data_size=5), "expected 5 bytes of pixels, got: 4"),
        (grey(2, 2, data_size=2**32 - 1), "expected 4294967295 bytes"),
    ],
)
def test_a_message_that_is_not_a_frame_is_an_error(message, reason):
    with pytest.raises(FrameError, match=reason):
        decode(message)


@pytest.mark.parametrize(
    "changes, reason",
    [
        ({"stride": 1}, "at least 2 bytes, got: 1"),
        ({"width": 3}, "at least 3 bytes, got: 2"),
        ({"height": 3}, "expected 6 bytes of pixels, got: 4"),
        ({"height": 2**32 - 1, "stride": 2**32 - 1}, "expected .* bytes of pixels, got: 4"),
        ({"plane_count": 2}, "got: 2 planes"),
        ({"fourcc": "MJPG"}, "expected one of: 'GREY'"),
    ],
)
def test_missing_pixels_are_an_error(changes, reason):
    frame = decode(grey(2, 2, **changes))
    with pytest.raises(FrameError, match=reason):
        _ = frame.pixels
    assert len(frame.data) == 4


def test_pixels_outlive_message_frame_and_lease(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        publisher.publish(grey(3, 4))
        publisher.publish(grey(3, 4))
        first = decode(subscriber.recv(timeout=0)).pixels
        with subscriber.lease() as lease:
            second = decode(lease).pixels
        for _ in range(50):
            publisher.publish(bytes(56))
            with subscriber.lease() as lease:
                assert not lease.array().any()
    assert first[2].tolist() == second[2].tolist() == [20, 21, 22, 23]


def test_growing_the_bytes_under_pixels_is_refused():
    message = bytearray(grey(3, 4))
    pixels = decode(message).pixels
    with pytest.raises(BufferError):
        message.extend(bytes(100_000))
    assert pixels[2, 3] == 23


def test_the_cameras_frames_are_read(start, topic):
    with Subscriber(topic) as subscriber:
        camera = start(
            os.environ["CONDUIT_RING_CAMERA"],
            "--topic", topic, "--rate", 50, "--width", 320, "--height", 240, "--exit-with-stdin",
        )  # fmt: skip
        seen = []
        while len(seen) < 5:
            message = subscriber.recv(timeout=LIMIT)
            assert isinstance(message, Message)
            frame = decode(message)
            assert frame.header.timestamp_ns <= message.timestamp_ns <= now_ns()
            assert frame.pixels.shape == (240, 320)
            # The scene has bright paper and dark tags.
            assert frame.pixels.max() - frame.pixels.min() > 100
            seen.append(frame.header.frame_id)
        with subscriber.lease(timeout=LIMIT) as lease:
            frame = decode(lease)
            assert frame.pixels.shape == (240, 320)
            seen.append(frame.header.frame_id)
        assert seen == sorted(set(seen))
        assert info(topic).encoding == frames.ENCODING
        status, _ = camera.end()
        assert status == 0
