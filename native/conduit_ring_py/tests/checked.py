"""Messages with a checksum, as in peer/src/main.rs."""

import struct

LONGEST = 3016
_HEAD = struct.Struct("<QQ")


def message(n):
    """Return message n: its number, the FNV-1a hash of the rest, and bytes that depend on n."""
    length = (n * 2654435761 & 0xFFFFFFFF) % 3000
    body = bytes((n * 31 + i * 7) & 0xFF for i in range(16, 16 + length))
    return _HEAD.pack(n, _fnv(body)) + body


def number(data):
    """Return the number of a complete message."""
    n, checksum = _HEAD.unpack_from(data)
    assert checksum == _fnv(data[_HEAD.size :]), f"message {n} is torn"
    assert len(data) == 16 + (n * 2654435761 & 0xFFFFFFFF) % 3000, f"message {n} is cut"
    return n


def _fnv(data):
    checksum = 0xCBF29CE484222325
    for byte in data:
        checksum = (checksum ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return checksum
