"""The gallery: a page for every problem file."""

from __future__ import annotations

from pathlib import Path


def write(folder: Path) -> None:
    """Write the pages."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "index.md").write_text("# Gallery\n", encoding="utf-8")
