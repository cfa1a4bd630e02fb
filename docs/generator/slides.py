"""Slides of the lessons: formulas, pictures, tables and short lists, with at most five lines of text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import escape
from pathlib import Path

from bs4 import BeautifulSoup, Tag

LETTERS, LINES = 85, 5
"""Largest number of letters in a line, largest number of lines on a slide."""
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}, slides</title>
<link rel="icon" href="../../_static/icon.svg"><link rel="stylesheet" href="../../_static/slides.css">
<script>MathJax = {{ options: {{ enableMenu: false }} }};</script>
<script defer src="../../_static/slides.js"></script><script defer src="../../_static/formulas.js"></script>
<script defer src="../../_static/mathjax/tex-svg-full.js"></script>
</head><body><main>{slides}
</main></body></html>
"""


def write(site: Path) -> None:
    """Write the slides of every lesson into the folder `slides` beside the lessons."""
    folder = site / "learn" / "slides"
    folder.mkdir(exist_ok=True)
    for path in sorted((site / "learn").glob("lesson_*.html")):
        if "solutions" not in path.stem:
            (folder / path.name).write_text(build_page(path), encoding="utf-8")


def build_page(path: Path) -> str:
    """Return the slides of a lesson as HTML."""
    body = BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser").find("article").find("section")
    for link in body.find_all("a", class_="headerlink"):
        link.decompose()
    for tag in body.find_all(True):
        readdress(tag, path.name)
    title = body.find("h1").get_text(strip=True)
    made = list(build_slides(list(find_blocks(body))))
    back = f'<a href="../{path.name}">{escape(title.partition(",")[0])}</a>'
    feet = [f"{back} {number} / {len(made)}" for number in range(1, len(made) + 1)]
    feet[1:] = [foot.replace("<a ", '<a tabindex="-1" ') for foot in feet[1:]]  # only the first link is a tab stop
    slides = "\n".join(
        f'<section tabindex="-1"><div>{slide}</div><p class="where">{foot}</p></section>'
        for slide, foot in zip(made, feet, strict=True)
    )
    unbroken = re.sub(r'(<span class="math[^"]*">[^<]*</span>[.,;:?!]+)', r'<span class="unbroken">\1</span>', slides)
    return PAGE.format(title=escape(title), slides=unbroken)


def readdress(tag: Tag, page: str) -> None:
    """Adapt a link of a lesson's page to the folder of slides."""
    tag.attrs.pop("id", None)
    for attribute in ("href", "src"):
        address = tag.get(attribute, "")
        if address.startswith("#"):
            tag[attribute] = f"../{page}{address}"
        elif address and not re.match(r"\w+:|/", address):
            tag[attribute] = f"../{address}"


def find_blocks(section: Tag) -> Iterator[Tag]:
    """Yield the blocks of a section and of its subsections, in order."""
    for child in section.find_all(True, recursive=False):
        if child.name == "section":
            yield from find_blocks(child)
        elif child.get_text(strip=True) or child.find("img"):
            yield child


def build_slides(blocks: list[Tag]) -> Iterator[str]:
    """Yield the slides of a lesson."""
    heading = str(blocks[0]).replace("h1>", "h2>")
    yield str(blocks[0]) + "".join(f"<p>{part}</p>" for part in fit(split_sentences(blocks[1]), LINES, first=True))
    for at, block in enumerate(blocks):
        following = blocks[at + 1 : at + 3]
        if block.name == "h2":
            heading = str(block)
        elif is_shown(block):
            inside = sum(count_lines(str(item)) for item in block.find_all("li"))
            before = split_sentences(blocks[at - 1])
            before = fit(before[bool(before) and before[0][0].islower() :], max(LINES - 2 - inside, 1))
            after = [one for one in split_sentences(following[0])[:1] if one[0].islower()] if following else []
            yield f"{heading}<p>{' '.join(before)}</p>{block}<p>{' '.join(after)}</p>".replace("<p></p>", "")
        elif block.find("img"):
            near = [*blocks[max(at - 3, 0) : at][::-1], *following]
            asked = next((one for one in near if one.name == "p" and "Question:" in one.get_text()), None)
            text = split_sentences(asked or next((one for one in near if one.name == "p"), near[0]))
            answer = next((one for one in near if one.name == "details"), "") if asked else ""
            start = next((n for n, sentence in enumerate(text) if "Question:" in sentence), 0)
            text = [sentence for sentence in text[start:] if sentence[-1] in ".?!)"]
            yield f"{heading}{block.find('img')}<p>{' '.join(fit(text, LINES, first=True))}</p>{answer}"


def is_shown(block: Tag) -> bool:
    """Return True for a formula on lines of its own, a table, or a list of fewer than LINES lines."""
    if block.name == "ul":
        return sum(count_lines(str(item)) for item in block.find_all("li")) < LINES
    return bool({"math", "math-wrapper", "table-wrapper"} & set(block.get("class", ())))


def split_sentences(paragraph: Tag) -> list[str]:
    """Return the sentences of a paragraph as HTML."""
    sentences = [""]
    for part in re.split(r"(?<=[.?!])\s+", paragraph.decode_contents() if paragraph.name == "p" else ""):
        is_open = len(re.findall(r"<\w", sentences[-1])) > sentences[-1].count("</")
        sentences[-1:] = [f"{sentences[-1]} {part}"] if is_open else [sentences[-1], part]
    return [sentence for sentence in sentences if sentence]


def fit(sentences: list[str], lines: int, first: bool = False) -> list[str]:
    """Return the last (or first) sentences that fit into `lines` lines."""
    kept = sentences if first else sentences[::-1]
    while len(kept) > 1 and count_lines(" ".join(kept)) > lines:
        kept = kept[:-1]
    return kept if first else kept[::-1]


def count_lines(html: str) -> int:
    """Return the number of lines of some HTML."""
    return -(-len(re.sub(r"\\[a-zA-Z]+|\\.|[{}_^]", "x", re.sub(r"<[^>]+>", "", html))) // LETTERS)
