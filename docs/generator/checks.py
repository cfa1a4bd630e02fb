"""Checks of pages: loaded files, links, descriptions of pictures, order of headings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote, urlsplit

from bs4 import BeautifulSoup

IN_STYLE = re.compile(r"(?:url\(|@import)\s*['\"]?\s*((?:https?:)?//[^'\")]+)")
MADE_LATER = "search.html", "genindex.html"
"""Pages whose headings are not checked."""


def find_faults(site: Path) -> list[str]:
    """Return the faults of all pages and styles, one string per fault."""
    found = []
    for path in sorted((*site.rglob("*.html"), *site.rglob("*.css"))):
        text = path.read_text(encoding="utf-8")
        faults = [f"a style loads {address}" for address in IN_STYLE.findall(text)]
        if path.suffix == ".html":
            page = BeautifulSoup(text, "html.parser")
            faults += [*_check_tags(path, page), *(() if path.name in MADE_LATER else _check_headings(page))]
        found += [f"{path.relative_to(site)}: {fault}" for fault in faults]
    return found


def _check_tags(path: Path, page: BeautifulSoup) -> Iterator[str]:
    """Yield faults: missing files, files of other hosts, pictures without description."""
    for tag in page.find_all(True):
        address = urlsplit(next((tag[name] for name in ("href", "src", "data") if tag.get(name)), ""))
        if address.netloc:
            yield from [f"<{tag.name}> loads {address.geturl()}"] * (tag.name != "a")
        elif address.path and not address.scheme and not (path.parent / unquote(address.path)).is_file():
            yield f"<{tag.name}> leads to {address.geturl()}, which does not exist"
        text = tag.get("title" if tag.name == "iframe" else "alt", "").strip()
        if tag.name in ("img", "iframe") and (not text or Path(text).suffix in (".png", ".svg", ".gif")):
            yield f"<{tag.name}> of {tag.get('src', '')[:80]} has no text"


def _check_headings(page: BeautifulSoup) -> Iterator[str]:
    """Yield faults: several or no headings of the first level, or skipped levels."""
    body = page.find("article") or page.find("main") or page
    levels = [int(tag.name[1]) for tag in body.find_all(re.compile(r"^h[1-6]$"))]
    if levels.count(1) != 1:
        yield f"{levels.count(1)} headings of the first level"
    for before, after in pairwise(levels):
        if after > before + 1:
            yield f"a heading of level {after} follows one of level {before}"
