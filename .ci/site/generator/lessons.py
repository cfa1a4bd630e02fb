"""Lessons as notebooks for MyST-NB, and the page that lists them."""

from __future__ import annotations

import json
from pathlib import Path

from vemcvx.cli.notebook import notebook
from vemcvx.cli.supplied import Supplied, lessons


def write(folder: Path) -> None:
    """Write `lesson_N.ipynb` and `lesson_N_solutions.ipynb`, which MyST-NB runs, beside the pages of the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, lesson in lessons().items():
        _write(lesson.path, folder / f"lesson_{number}.ipynb", _links(number, lesson))
        solutions = lesson.path.with_name(f"lesson_{number}_solutions.py")
        _write(solutions, folder / f"lesson_{number}_solutions.ipynb", "")


def _write(path: Path, into: Path, first: str) -> None:
    made = notebook(path.read_text(encoding="utf-8"))
    for cell in made["cells"]:
        if cell["metadata"]:
            cell["metadata"]["tags"] = ["hide-input"]
    text = json.dumps(made, indent=1, ensure_ascii=False)
    if not into.is_file() or into.read_text(encoding="utf-8") != text:
        into.write_text(text, encoding="utf-8")


def _links(number: int, lesson: Supplied) -> str:
    return ""
