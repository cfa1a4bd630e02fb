"""What every page of the built site must keep to: links, words for pictures, headings, nothing from other hosts."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote, urldefrag

from bs4 import BeautifulSoup

LOADS = {"img": "src", "script": "src", "iframe": "src", "link": "href", "source": "src", "object": "data"}
"""What a browser fetches without being asked."""
ELSEWHERE = re.compile(r"(?:https?:)?//|ftp:", re.IGNORECASE)
UNREAD = re.compile(r"[-—]{3,}|(?:^|[.)”\"] )\w+ : \S.*", re.MULTILINE)
"""The line below a section of a docstring, or a name of its lists, where they stand in running text."""
IN_STYLE = re.compile(r"(?:url\(|@import)\s*['\"]?\s*((?:https?:)?//[^'\")]+)")


def faults(site: Path) -> list[str]:
    """All faults found, a line each."""
    site = site.resolve()  # as the targets of links are
    paths = sorted(site.rglob("*.html"))
    parsed = {path: BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser") for path in paths}
    anchors = {path: {tag["id"] for tag in page.find_all(id=True)} for path, page in parsed.items()}
    found = []
    for path, page in parsed.items():
        of_page = [*_links(path, page, anchors), *_loads(path, page), *_pictures(page), *_ids(page), *_unread(page)]
        # The heading of the page of searches is made by its script.
        of_page += _headings(page) if path.name != "search.html" else []
        found += [f"{path.relative_to(site)}: {fault}" for fault in of_page]
    for style in site.rglob("*.css"):
        urls = IN_STYLE.findall(style.read_text(encoding="utf-8"))
        found += [f"{style.relative_to(site)}: loads {url}" for url in urls]
    return found


def _links(path: Path, page: BeautifulSoup, anchors: dict[Path, set[str]]) -> Iterator[str]:
    for tag in page.find_all("a", href=True):
        address, anchor = urldefrag(tag["href"])
        if ELSEWHERE.match(address) or address.startswith("mailto:"):
            continue
        target = (path.parent / unquote(address)).resolve() if address else path
        if not target.is_file():
            yield f"the link to {tag['href']} leads nowhere"
        elif anchor and unquote(anchor) not in anchors.get(target, ()):
            yield f"the link to {tag['href']} finds no such anchor"


def _loads(path: Path, page: BeautifulSoup) -> Iterator[str]:
    for name, attribute in LOADS.items():
        for tag in page.find_all(name, {attribute: True}):
            address = urldefrag(tag[attribute])[0]
            if ELSEWHERE.match(address):
                yield f"<{name}> loads {address}"
            elif address and not address.startswith("data:"):
                file = path.parent / unquote(address.partition("?")[0])
                if not file.is_file() and tag.get("rel") not in (["next"], ["prev"], ["index"], ["search"]):
                    yield f"<{name}> loads {address}, which is not there"
    for style in (*page.find_all("style"), *page.find_all(style=True)):
        yield from (f"a style loads {url}" for url in IN_STYLE.findall(style.get("style", style.text)))


def _pictures(page: BeautifulSoup) -> Iterator[str]:
    for image in page.find_all("img"):
        words = image.get("alt", "").strip()
        if not words or Path(words).suffix in (".png", ".svg", ".gif"):
            yield f"the picture {image.get('src', '')[:80]} has no words"
    untitled = [frame for frame in page.find_all("iframe") if not frame.get("title")]
    yield from (f"the frame {frame.get('src')} has no title" for frame in untitled)


def _unread(page: BeautifulSoup) -> Iterator[str]:
    """Sections of docstrings that were not read as such."""
    for paragraph in page.find_all("p"):
        found = UNREAD.search(paragraph.get_text())
        if found and paragraph.find_parent("table") is None:
            yield f"the paragraph {paragraph.get_text()[:60]!r} has {found.group()[:60]!r} in running text"


def _headings(page: BeautifulSoup) -> Iterator[str]:
    """One of the first level, and none is skipped."""
    body = page.find("article") or page.find("main") or page.body
    levels = [(int(tag.name[1]), tag.get_text(" ", strip=True)) for tag in body.find_all(re.compile(r"^h[1-6]$"))]
    if [level for level, _ in levels].count(1) != 1:
        yield f"{[level for level, _ in levels].count(1)} headings of the first level"
    for (before, _), (level, words) in pairwise(levels):
        if level > before + 1:
            yield f"the heading {words!r} is of level {level} below one of level {before}"


def _ids(page: BeautifulSoup) -> Iterator[str]:
    counted = Counter(tag["id"] for tag in page.find_all(id=True) if not tag.find_parent("svg"))
    yield from (f"{times} elements have the id {one}" for one, times in counted.items() if times > 1)
