"""README.md, CONTRIBUTING.md and the pages of the site, and functions that return parts of these texts."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
SITE = ROOT / "docs"
README, CONTRIBUTING = ROOT / "README.md", ROOT / "CONTRIBUTING.md"
PAGES = sorted({*SITE.rglob("*.md")} - {SITE / "README.md"})
"""The written pages. The site builder makes all other pages."""
TEXTS = [README, CONTRIBUTING, *PAGES]


def page(name: str) -> str:
    """Return the text of a page of the site, such as "howto/own_solver"."""
    return (SITE / f"{name}.md").read_text(encoding="utf-8")


def blocks(text: str, kind: str) -> list[str]:
    """Return the contents of the fenced blocks of a kind, without options (":tags: ...")."""
    found = re.findall(rf"^```{re.escape(kind)}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return [re.sub(r"\A(?::.*\n)+\n?", "", block) for block in found]


def cells(text: str) -> list[str]:
    """Return the Python blocks that the site runs, in the order of the page."""
    return blocks(text, "{code-cell}")


def files(text: str) -> dict[str, str]:
    """Return the files that a page shows, by caption."""
    shown = r"^```\{code-block\} \w+\n:caption: (.+)\n(?::.*\n)*\n((?:.*\n)*?)```$"
    return dict(re.findall(shown, text, re.MULTILINE))


def prose(text: str) -> str:
    """Return the text without its fenced blocks."""
    return re.sub(r"^(`{3,}|:{3,})\{?code.*?^\1$|^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)


def is_made(path: Path) -> bool:
    """Return True if the site builder makes this page from a lesson, a problem file or docstrings."""
    folder, _, name = path.relative_to(SITE).with_suffix("").as_posix().partition("/")
    if folder == "learn":
        return name == "index" or any((ROOT / "problems" / "lessons").glob(f"{name}*.py"))
    if folder == "gallery":
        return name == "index" or (ROOT / "problems" / f"{name}.py").exists()
    return folder == "reference"
