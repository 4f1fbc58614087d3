"""The dumps of docs/wire-format.md, which the tests of every language read."""

import re
from pathlib import Path

_PAGE = Path(__file__).parents[3] / "docs/wire-format.md"


def vector(name):
    """The bytes of the dump with this name. ``00*4`` is four times a byte; from # to the end of a line is comment."""
    (dump,) = re.findall(rf"^```hex {name}\n(.*?)^```", _PAGE.read_text(), re.M | re.S)
    words = (word.split("*") for line in dump.splitlines() for word in line.partition("#")[0].split())
    return b"".join(bytes.fromhex(byte) * int(*times or "1") for byte, *times in words)
