"""Camera frames of encoding :data:`ENCODING`: a header of 44 bytes, then uncompressed pixels.

>>> import numpy
>>> pixels = numpy.zeros((480, 640), numpy.uint8)
>>> message = FrameHeader.of(pixels, timestamp_ns=1, frame_id=7).encode() + pixels.tobytes()
>>> frame = decode(message)
>>> frame.header.frame_id, frame.pixels.shape
(7, (480, 640))

With a camera's topic:

>>> for message in subscriber:                                        # doctest: +SKIP
...     frame = decode(message)
...     print(frame.header.frame_id, frame.pixels.mean())
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Union

if TYPE_CHECKING:
    import numpy
    from numpy.typing import NDArray

    from . import Lease, Message

    Source = Union[bytes, bytearray, memoryview, Message, Lease, NDArray[numpy.uint8]]

__all__ = ["ENCODING", "Frame", "FrameError", "FrameHeader", "decode"]

ENCODING = "conduit/frame"
"""The encoding's name, for ``Publisher(content=...)``."""

CLOCK_MONOTONIC_RAW = 4
"""Linux's number of the clock of :func:`conduit_ring.now_ns`."""

_LAYOUT = struct.Struct("<HBBIIIIIQBBBBII")
_MAGIC = 0x4D43
_VERSION = 1

# For each pixel format with one plane: the type of its numbers, and their count per pixel. A
# pixel of YUYV and UYVY has a brightness and, in turn, one of two colour differences.
_FORMATS = {
    "GREY": ("u1", 1),
    "Y16 ": ("<u2", 1),
    "RGB3": ("u1", 3),
    "BGR3": ("u1", 3),
    "YUYV": ("u1", 2),
    "UYVY": ("u1", 2),
}


class FrameError(ValueError):
    """A message is not a frame, has too few pixels, or has an unknown pixel format."""


@dataclass(frozen=True)
class FrameHeader:
    """The header of a frame."""

    SIZE = _LAYOUT.size

    width: int
    """Pixels in a row."""
    height: int
    """Rows."""
    fourcc: str
    """V4L2's code for the pixel format, such as ``"GREY"``."""
    stride: int
    """Bytes from the start of a row to the start of the next."""
    data_size: int
    """Bytes of pixels after the header."""
    timestamp_ns: int
    """Start of the exposure by the clock ``clock_id``."""
    frame_id: int
    """The camera's own count of its frames."""
    flags: int = 0
    """Reserved."""
    clock_id: int = CLOCK_MONOTONIC_RAW
    """Linux's number of the clock."""
    plane_count: int = 1
    """Number of planes."""
    rotation: int = 0
    """Mounting of the camera; 0 is upright."""
    colourspace: int = 0
    """V4L2's ``enum v4l2_colorspace``; 0 means not stated."""
    exposure_us: int = 0
    """Exposure time in µs; 0 means not known."""

    @classmethod
    def of(
        cls, pixels: NDArray[Any], timestamp_ns: int, frame_id: int, fourcc: str = "GREY"
    ) -> FrameHeader:
        """Return the header of an array of pixels, without padding between rows.

        Publish both without joining them: ``publisher.publish(header.encode(), pixels)``.

        Raises
        ------
        FrameError
            If shape or type do not match the pixel format.
        """
        kind, depth = _format(fourcc)
        shape = pixels.shape[:2] if depth == 1 else pixels.shape[:2] + (depth,)
        if pixels.ndim < 2 or pixels.shape != shape or pixels.dtype != kind:
            axes = f"(height, width{f', {depth}' if depth > 1 else ''})"
            raise FrameError(
                f"invalid pixels for {fourcc}: expected shape {axes} and type {kind}, "
                f"got: shape {pixels.shape} and type {pixels.dtype}"
            )
        height, width = pixels.shape[:2]
        stride = width * depth * pixels.itemsize
        return cls(width, height, fourcc, stride, stride * height, timestamp_ns, frame_id)

    @classmethod
    def parse(cls, data: Union[bytes, bytearray, memoryview]) -> FrameHeader:
        """Parse the header at the start of a message.

        Raises
        ------
        FrameError
            If the message does not start with a header of this version.
        """
        if len(data) < cls.SIZE:
            raise FrameError(
                f"expected a frame header of {cls.SIZE} bytes, got: {len(data)} bytes"
            )
        fields = _LAYOUT.unpack_from(data)
        magic, version, flags, width, height, fourcc, stride, data_size, timestamp_ns = fields[:9]
        clock_id, plane_count, rotation, colourspace, frame_id, exposure_us = fields[9:]
        if magic != _MAGIC:
            raise FrameError('expected a frame, which starts with "CM"')
        if version != _VERSION:
            raise FrameError(
                f"expected version {_VERSION} of the frame header, got: version {version}"
            )
        return cls(
            width=width,
            height=height,
            fourcc=fourcc.to_bytes(4, "little").decode("latin-1"),
            stride=stride,
            data_size=data_size,
            timestamp_ns=timestamp_ns,
            frame_id=frame_id,
            flags=flags,
            clock_id=clock_id,
            plane_count=plane_count,
            rotation=rotation,
            colourspace=colourspace,
            exposure_us=exposure_us,
        )

    def encode(self) -> bytes:
        """Encode the header to 44 bytes."""
        fourcc = int.from_bytes(self.fourcc.encode("latin-1"), "little")
        return _LAYOUT.pack(
            _MAGIC,
            _VERSION,
            self.flags,
            self.width,
            self.height,
            fourcc,
            self.stride,
            self.data_size,
            self.timestamp_ns,
            self.clock_id,
            self.plane_count,
            self.rotation,
            self.colourspace,
            self.frame_id,
            self.exposure_us,
        )


@dataclass(frozen=True)
class Frame:
    """A frame in a message: its header, checked against the message's size, and its pixels."""

    header: FrameHeader
    data: memoryview
    """``data_size`` bytes of pixels in the message."""

    @property
    def pixels(self) -> NDArray[Any]:
        """The pixels as a numpy array, without a copy.

        The shape is (height, width), with a third axis if a pixel has several numbers.

        Raises
        ------
        FrameError
            For an unknown pixel format, whose bytes are in :attr:`data`.
        """
        import numpy

        header = self.header
        kind, depth = _format(header.fourcc)
        dtype = numpy.dtype(kind)
        row = header.width * depth * dtype.itemsize
        _check_rows(header, row)
        axes = [
            (header.height, header.stride),
            (header.width, depth * dtype.itemsize),
            (depth, dtype.itemsize),
        ]
        shape, strides = zip(*(axes if depth > 1 else axes[:2]))
        # An array over the bytes keeps their memory, which a memoryview alone would not.
        flat = numpy.frombuffer(self.data, numpy.uint8)
        return numpy.ndarray(shape, dtype, buffer=flat, strides=strides)


def decode(message: Source) -> Frame:
    """Decode a frame in a message, a lease or any bytes, without a copy.

    Bytes after the pixels are ignored.

    Raises
    ------
    FrameError
        If the message is not a frame.
    """
    source: Any = message
    data = memoryview(getattr(source, "data", source)).cast("B")
    header = FrameHeader.parse(data)
    rest = data[FrameHeader.SIZE :]
    if header.width == 0 or header.height == 0:
        raise FrameError("frame has no pixels")
    if header.plane_count == 0:
        raise FrameError("frame has an impossible number of planes: 0")
    if header.data_size > len(rest):
        raise FrameError(
            f"expected {header.data_size} bytes of pixels, got: {len(rest)} bytes"
        )
    return Frame(header, rest[: header.data_size])


def _format(fourcc: str) -> tuple[str, int]:
    if fourcc not in _FORMATS:
        known = ", ".join(map(repr, _FORMATS))
        raise FrameError(f"unknown pixel format {fourcc!r}; expected one of: {known}")
    return _FORMATS[fourcc]


def _check_rows(header: FrameHeader, row: int) -> None:
    if header.plane_count != 1:
        raise FrameError(f"expected a frame with 1 plane, got: {header.plane_count} planes")
    if header.stride < row:
        raise FrameError(f"expected a stride of at least {row} bytes, got: {header.stride}")
    needed = header.stride * (header.height - 1) + row
    if needed > header.data_size:
        raise FrameError(f"expected {needed} bytes of pixels, got: {header.data_size} bytes")
