"""Buffers as numpy arrays. numpy is needed by whoever asks for an array, and by nobody else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray


def view(buffer: Any, dtype: Any = None, shape: Any = None, offset: int = 0) -> NDArray[Any]:
    """An array over a buffer whose bytes stay where they are while it lives, as writable as it is. Nothing is copied."""
    import numpy

    dtype = numpy.dtype("uint8" if dtype is None else dtype)
    if dtype.hasobject or dtype.itemsize == 0:
        raise ValueError(f"dtype is {dtype}, which cannot be read from bytes")
    data = memoryview(buffer)
    size = len(data) - offset
    if size < 0:
        raise ValueError(f"offset is {offset} and the message has {len(data)} bytes")
    if size % dtype.itemsize:
        raise ValueError(f"{size} bytes are no whole number of items of {dtype.itemsize} bytes ({dtype})")
    items = numpy.ndarray((size // dtype.itemsize,), dtype, buffer=data, offset=offset)
    return items if shape is None else items.reshape(shape)
