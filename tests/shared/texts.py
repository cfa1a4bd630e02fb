"""The texts of the project, README.md, CONTRIBUTING.md and the pages of the site, and what stands in them."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
SITE = ROOT / "docs"
README, CONTRIBUTING = ROOT / "README.md", ROOT / "CONTRIBUTING.md"
PAGES = sorted({*SITE.rglob("*.md")} - {SITE / "README.md"})
"""Those that are written; lessons, problems and the reference get pages when the site is built."""
TEXTS = [README, CONTRIBUTING, *PAGES]


def page(name: str) -> str:
    """The text of a page of the site, such as "howto/solver"."""
    return (SITE / f"{name}.md").read_text(encoding="utf-8")


def blocks(text: str, kind: str) -> list[str]:
    """What stands in its fenced blocks of a kind, without options (":tags: ...")."""
    found = re.findall(rf"^```{re.escape(kind)}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return [re.sub(r"\A(?::.*\n)+\n?", "", block) for block in found]


def cells(text: str) -> list[str]:
    """The Python that the site runs, in the page's order."""
    return blocks(text, "{code-cell}")


def file(text: str, caption: str) -> str:
    """A file that a page shows, by its name."""
    head = rf"```\{{code-block\}} python\n:caption: {re.escape(caption)}\n\n"
    (found,) = re.findall(rf"^{head}(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return found


def prose(text: str) -> str:
    """The text without its fenced blocks."""
    return re.sub(r"^(`{3,}|:{3,})\{?code.*?^\1$|^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)


def is_made(path: Path) -> bool:
    """Whether the site makes this page, of a lesson, a problem file or docstrings."""
    folder, _, name = path.relative_to(SITE).with_suffix("").as_posix().partition("/")
    if folder == "learn":
        return name == "index" or any((ROOT / "problems" / "lessons").glob(f"{name}*.py"))
    if folder == "gallery":
        return name == "index" or (ROOT / "problems" / f"{name}.py").exists()
    return folder == "reference"
