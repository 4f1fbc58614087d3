"""Checks that every link of a site resolves, and that no page loads files from another host.

    links.py FOLDER [FOLDER-THAT-IS-NOT-READ ...]
"""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

# Elements and attributes whose target a browser loads with the page.
FETCHED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}


class Page(HTMLParser):
    def __init__(self, path):
        super().__init__()
        self.anchors, self.links, self.fetched = set(), set(), set()
        self.feed(path.read_text(encoding="utf-8", errors="replace"))

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.anchors.update(attributes[key] for key in ("id", "name") if attributes.get(key))
        if tag == "a" and attributes.get("href"):
            self.links.add(attributes["href"])
        if tag in FETCHED and attributes.get(FETCHED[tag]):
            self.fetched.add(attributes[FETCHED[tag]])


def broken_links(root, not_read):
    pages = {}

    def page(path):
        if path not in pages:
            pages[path] = Page(path)
        return pages[path]

    for path in sorted(root.rglob("*.html")):
        if any(folder in path.parents for folder in not_read):
            continue
        for link in sorted(page(path).fetched | page(path).links):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page(path).fetched and parts.scheme != "data":
                    yield f"{path}: fetches {link} from another host"
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.is_file():
                yield f"{path}: {link} is broken"
            elif parts.fragment and target.suffix == ".html":
                if {parts.fragment, unquote(parts.fragment)}.isdisjoint(page(target).anchors):
                    yield f"{path}: {link}: that page has no such anchor"


if __name__ == "__main__":
    root = Path(sys.argv[1]).resolve()
    found = list(broken_links(root, [Path(folder).resolve() for folder in sys.argv[2:]]))
    print(*found, sep="\n", end="\n" if found else "", file=sys.stderr)
    sys.exit(bool(found))
