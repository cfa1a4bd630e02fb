"""Slides of the lessons, from the pages that their cells became: a page that snaps from slide to slide.

The slides are one page of HTML, without a framework: space, arrows and page keys go on, CSS stops at each slide, and a
printer puts one on a sheet. nbconvert's slides would need reveal.js from another host, or a copy of it here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import escape
from pathlib import Path

from bs4 import BeautifulSoup, Tag

FULL = 900
"""Letters that a slide holds beside its heading; a picture counts for 600, a line of code for 60, a formula for 150."""
SHORT = 12
"""Lines of code that are shown; longer code is folded."""
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}, slides</title>
<link rel="icon" href="../../_static/icon.svg">
<link rel="stylesheet" href="../../_static/pygments.css"><link rel="stylesheet" href="../../_static/slides.css">
<script defer src="../../_static/slides.js"></script><script defer src="../../_static/mathjax/tex-svg-full.js"></script>
</head><body><main>
{slides}
</main></body></html>
"""


def write(site: Path) -> None:
    """Write the slides of every lesson beside its page."""
    folder = site / "learn" / "slides"
    folder.mkdir(exist_ok=True)
    for path in sorted((site / "learn").glob("lesson_*.html")):
        if "solutions" not in path.stem:
            (folder / path.name).write_text(_slides(path), encoding="utf-8")


def _slides(path: Path) -> str:
    page = BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser")
    body = page.find("article").find("section")
    for link in body.find_all("a", class_="headerlink"):
        link.decompose()
    for tag in body.find_all(True):
        _moved(tag, path.name)
    for cell in body.find_all("div", class_="cell_input"):
        _folded(page, cell)
    title = body.find("h1").get_text(strip=True)
    made = list(_packed(list(_blocks(body))))
    foot = f'<p class="where"><a href="../{path.name}">{escape(title.partition(",")[0])}</a> {{0}} / {len(made)}</p>'
    slides = "\n".join(f"<section>{slide}{foot.format(n)}</section>" for n, slide in enumerate(made, 1))
    return PAGE.format(title=escape(title), slides=slides)


def _moved(tag: Tag, page: str) -> None:
    """Slides are a folder below their lesson; anchors are those of the lesson."""
    tag.attrs.pop("id", None)
    for attribute in ("href", "src"):
        address = tag.get(attribute, "")
        if address.startswith("#"):
            tag[attribute] = f"../{page}{address}"
        elif address and not re.match(r"\w+:|/", address):
            tag[attribute] = f"../{address}"


def _folded(page: BeautifulSoup, cell: Tag) -> None:
    if cell.find_parent("details") is None and cell.get_text().strip().count("\n") >= SHORT:
        fold = page.new_tag("details")
        summary = page.new_tag("summary")
        summary.string = "Code"
        cell.wrap(fold).insert(0, summary)


def _blocks(section: Tag) -> Iterator[Tag]:
    """What stands in a section and those within it, in order."""
    for child in section.find_all(True, recursive=False):
        if child.name == "section":
            yield from _blocks(child)
        elif child.get_text(strip=True) or child.find("img"):
            yield child


def _weight(block: Tag) -> int:
    pictures = 600 * len(block.find_all("img")) + 150 * len(block.find_all("div", class_="math"))
    if "cell" in block.get("class", ()):
        shown = [pre for pre in block.find_all("pre") if pre.find_parent("details") is None]
        return pictures + sum(60 * (1 + pre.get_text().count("\n")) for pre in shown)
    return pictures + (0 if block.name == "details" else len(block.get_text()))


def _packed(blocks: list[Tag]) -> Iterator[str]:
    """Slides of as many blocks as they hold; a heading begins one, and is repeated where its section goes on."""
    heading, held, weight = "", [], 0
    for block in blocks:
        begins = block.name in ("h1", "h2")
        if held and (begins or weight + _weight(block) > FULL) and not _answers(block):
            yield heading + "".join(held)
            heading, held, weight = heading.replace("h1>", "h2>"), [], 0
        if begins:
            heading = str(block)
        else:
            held.append(str(block))
            weight += _weight(block)
    yield heading + "".join(held)


def _answers(block: Tag) -> bool:
    return block.name == "details"
