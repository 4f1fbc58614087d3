"""Buffers as numpy arrays. Only a call that returns an array needs numpy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray


def view(buffer: Any, dtype: Any = None, shape: Any = None, offset: int = 0) -> NDArray[Any]:
    """Return an array over a buffer, without a copy.

    The array is writable if the buffer is. The buffer's bytes must not move while it lives.
    """
    import numpy

    dtype = numpy.dtype("uint8" if dtype is None else dtype)
    if dtype.hasobject or dtype.itemsize == 0:
        raise ValueError(f"invalid dtype: expected a type of plain bytes, got: {dtype}")
    data = memoryview(buffer)
    size = len(data) - offset
    if size < 0:
        raise ValueError(f"invalid offset: expected at most {len(data)} bytes, got: {offset}")
    if size % dtype.itemsize:
        raise ValueError(
            f"expected a multiple of {dtype.itemsize} bytes, the size of {dtype}, got: {size}"
        )
    items = numpy.ndarray((size // dtype.itemsize,), dtype, buffer=data, offset=offset)
    return items if shape is None else items.reshape(shape)
