"""Messages that prove themselves, as peer/src/main.rs has them in Rust."""

import struct

LONGEST = 3016
_HEAD = struct.Struct("<QQ")


def message(n):
    """Message n: its number, FNV-1a of what follows, and bytes that follow from the number."""
    length = (n * 2654435761 & 0xFFFFFFFF) % 3000
    body = bytes((n * 31 + i * 7) & 0xFF for i in range(16, 16 + length))
    return _HEAD.pack(n, _fnv(body)) + body


def number(data):
    """The number of a message that is whole."""
    n, checksum = _HEAD.unpack_from(data)
    assert checksum == _fnv(data[_HEAD.size :]), f"message {n} is torn"
    assert len(data) == 16 + (n * 2654435761 & 0xFFFFFFFF) % 3000, f"message {n} is cut"
    return n


def _fnv(data):
    checksum = 0xCBF29CE484222325
    for byte in data:
        checksum = (checksum ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return checksum
