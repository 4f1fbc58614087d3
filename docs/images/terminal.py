#!/usr/bin/env python3
"""Draws the output of a command as a terminal, in SVG.

    bin/demo --seconds 20 | docs/images/terminal.py "bin/demo" >docs/images/demo.svg

If the command prints several screens, as bin/demo does, it draws the last whole one.
"""

import re
import sys
from html import escape

SIZE, LINE, MARGIN, BAR = 14, 19, 18, 34
WIDTH = SIZE * 0.6
FONT = "ui-monospace, SFMono-Regular, Menlo, Consolas, 'DejaVu Sans Mono', monospace"
# The panel is dark, so that the picture looks the same on light and dark pages.
COLOURS = {"panel": "#161b22", "edge": "#57606a", "title": "#8b949e", "text": "#e6edf3"}
GREEN, RED = "#56d364", "#ff7b72"
WORDS = {"up": GREEN, "live": GREEN, "backoff": RED, "stale": RED, "dead": RED}


def last_screen(text):
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
    screens = re.split(r"^(?=ganglion, \d+ s)", text, flags=re.M)
    screen = screens[-1].split("\nsummary after ")[0]
    return [line.rstrip() for line in screen.rstrip().split("\n")]


def placed(line):
    """Places each column at its position, independent of the font."""
    for run in re.finditer(r"\S+(?: \S+)*", line):
        x = round(MARGIN + run.start() * WIDTH, 1)
        colour = f' fill="{WORDS[run[0]]}"' if run[0] in WORDS else ""
        yield f'<tspan x="{x}"{colour}>{escape(run[0])}</tspan>'


def drawing(lines, title):
    width = round(max(len(line) for line in lines) * WIDTH) + 2 * MARGIN
    height = BAR + len(lines) * LINE + MARGIN
    yield f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img"'
    yield f'     font-family="{FONT}" font-size="{SIZE}">'
    yield f"  <title>{escape(title)}</title>"
    yield f'  <rect x="0.5" y="0.5" width="{width - 1}" height="{height - 1}" rx="8"'
    yield f'        fill="{COLOURS["panel"]}" stroke="{COLOURS["edge"]}"/>'
    yield f'  <text x="{MARGIN}" y="22" fill="{COLOURS["title"]}">$ {escape(title)}</text>'
    yield f'  <g fill="{COLOURS["text"]}">'
    for number, line in enumerate(lines):
        if line:
            runs = "".join(placed(line))
            yield f'    <text y="{BAR + (number + 1) * LINE - 6}">{runs}</text>'
    yield "  </g>"
    yield "</svg>"


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] in ("-h", "--help"):
        sys.exit(__doc__)
    print("\n".join(drawing(last_screen(sys.stdin.read()), sys.argv[1])))
