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

FULL, TITLE = 560, 130
"""Pixels that a slide holds below its heading in a window of 1280 x 720, and those that a title of two lines takes."""
PICTURE, FORMULA, LINE, CODE, APART = 380, 80, 28, 22, 20
"""Pixels of a picture, a formula on its own, a line of text, one of code; and between blocks."""
LETTERS = 105
"""Of a line of text."""
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}, slides</title>
<link rel="icon" href="../../_static/icon.svg">
<link rel="stylesheet" href="../../_static/pygments.css"><link rel="stylesheet" href="../../_static/slides.css">
<script>MathJax = {{ options: {{ enableMenu: false }} }};</script>
<script defer src="../../_static/slides.js"></script><script defer src="../../_static/formulas.js"></script>
<script defer src="../../_static/mathjax/tex-svg-full.js"></script>
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
    for summary in body.select("details.hide > summary"):
        summary.string = "Code"
    title = body.find("h1").get_text(strip=True)
    made = list(_packed(_together(list(_blocks(body)))))
    back = f'<a href="../{path.name}">{escape(title.partition(",")[0])}</a>'
    feet = [f"{back} {n} / {len(made)}" for n in range(1, len(made) + 1)]
    feet[1:] = [foot.replace("<a ", '<a tabindex="-1" ') for foot in feet[1:]]  # the first is tab stop enough
    slides = "\n".join(
        f'<section tabindex="-1"><div>{slide}</div><p class="where">{foot}</p></section>'
        for slide, foot in zip(made, feet, strict=True)
    )
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


def _blocks(section: Tag) -> Iterator[Tag]:
    """What stands in a section and those within it, in order."""
    for child in section.find_all(True, recursive=False):
        if child.name == "section":
            yield from _blocks(child)
        elif child.get_text(strip=True) or child.find("img"):
            yield child


def _together(blocks: list[Tag]) -> Iterator[list[Tag]]:
    """Blocks that one slide shows: a paragraph and its formulas; a question below its picture, and its answer."""
    held: list[Tag] = []
    for at, block in enumerate(blocks):
        held.append(block)
        following = blocks[at + 1] if at + 1 < len(blocks) else None
        if following is None or not (_said_by(block, following) or _asked_of(block, following)):
            yield sorted(held, key=lambda one: not (_drawn(one) and any(map(_answers, held))))
            held = []


def _said_by(block: Tag, following: Tag) -> bool:
    """A sentence goes on in a formula, or beyond it."""
    words = following.get_text(strip=True)
    return _shown(following) if block.name == "p" else _shown(block) and words[:1].islower()


def _asked_of(block: Tag, following: Tag) -> bool:
    """A question and its answer, and the picture below."""
    return _answers(following) or (_answers(block) and _drawn(following))


def _answers(block: Tag) -> bool:
    return block.name == "details"


def _drawn(block: Tag) -> bool:
    """A cell of which the picture alone is shown."""
    return "tag_hide-input" in block.get("class", ()) and block.find("img") is not None


def _shown(block: Tag) -> bool:
    """A formula on its own."""
    return bool({"math", "math-wrapper"} & set(block.get("class", ())))


def _weight(block: Tag) -> int:
    """Pixels of a block, about; what is folded has the line that unfolds it."""
    if _answers(block):
        return LINE + APART
    if _shown(block):
        return FORMULA * (1 + block.get_text().count("\\\\") // 2)
    if "cell" in block.get("class", ()):
        shown = [pre for pre in block.find_all("pre") if pre.find_parent("details") is None]
        folded = LINE + APART if block.find("details") else 0
        lines = sum(CODE * len(pre.get_text().strip().splitlines()) + 2 * APART for pre in shown)
        return PICTURE * len(block.find_all("img")) + folded + lines
    items = block.find_all("li") or block.find_all("tr") or [block]
    return sum(LINE * (1 + len(item.get_text()) // LETTERS) + APART // 2 for item in items) + APART // 2


def _packed(groups: Iterator[list[Tag]]) -> Iterator[str]:
    """Slides of as many blocks as they hold; a heading begins one, and is repeated where its section goes on."""
    heading, held, weight = "", [], 0
    for group in groups:
        begins, weighs = group[0].name in ("h1", "h2"), sum(map(_weight, group))
        if held and (begins or weight + weighs > FULL):
            yield heading + "".join(held)
            heading, held, weight = heading.replace("h1>", "h2>"), [], 0
        if begins:
            heading, weight = str(group[0]), TITLE if group[0].name == "h1" else 0
        else:
            held += map(str, group)
            weight += weighs
    yield heading + "".join(held)
