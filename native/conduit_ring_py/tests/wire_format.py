"""The dumps of docs/wire-format.md, which the tests of all languages read."""

import re
from pathlib import Path

_PAGE = Path(__file__).parents[3] / "docs/wire-format.md"


def vector(name):
    """Return the bytes of the dump with this name.

    ``00*4`` repeats a byte four times, and # starts a comment.
    """
    (dump,) = re.findall(rf"^```hex {name}\n(.*?)^```", _PAGE.read_text(), re.M | re.S)
    lines = (line.partition("#")[0] for line in dump.splitlines())
    words = (word.split("*") for line in lines for word in line.split())
    return b"".join(bytes.fromhex(byte) * int(*times or "1") for byte, *times in words)
