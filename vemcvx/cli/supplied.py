"""Problem files and lessons of the package."""

from __future__ import annotations

import ast
import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vemcvx.base.errors import ProblemError

PACKAGE = Path(__file__).parents[1]
LESSON = re.compile(r"lesson_(\d+)_(?!solutions)\w+\.py")


@dataclass(frozen=True)
class Supplied:
    """A Python file of the package."""

    path: Path

    def _parse(self) -> ast.Module:
        return ast.parse(self.path.read_text(encoding="utf-8"))

    @property
    def sentence(self) -> str:
        """The first sentence of the file's docstring."""
        text = " ".join((ast.get_docstring(self._parse()) or "").removeprefix("# ").split())
        first = re.match(r".*?(?<!\W[A-Z])[.?!](?=\s|$)", text)  # An initial, such as J., does not end a sentence.
        return first.group() if first else text

    @property
    def is_problem(self) -> bool:
        """True for a problem file."""
        defined = {node.name for node in self._parse().body if isinstance(node, ast.FunctionDef)}
        return defined >= {"scene", "mesh", "times"} or defined >= {"mesh", "stages"}


def problems_folder() -> Path:
    """Return the folder of the problem files."""
    for place in (PACKAGE / "problems", PACKAGE.parent / "problems"):
        if (place / "lessons").is_dir():
            return place
    raise ProblemError(f"{PACKAGE}: found no problem files and lessons; install the package again.")


def problem_files() -> dict[str, Supplied]:
    """Return the problem files by name."""
    files = {path.stem: Supplied(path) for path in sorted(problems_folder().glob("*.py"))}
    return {name: file for name, file in files.items() if file.is_problem}


def lessons() -> dict[int, Supplied]:
    """Return the lessons by number."""
    named = [(LESSON.fullmatch(path.name), path) for path in (problems_folder() / "lessons").glob("*.py")]
    return dict(sorted((int(match.group(1)), Supplied(path)) for match, path in named if match))


def problem_path(file: str | Path) -> Path:
    """Return the path of a problem file, given by path or by name."""
    path = Path(file)
    if os.path.isfile(path) or path.name != str(file) or path.suffix:
        return path
    supplied = problems_folder() / f"{path.name}.py"
    if not (os.path.isfile(supplied) and Supplied(supplied).is_problem):
        raise ProblemError(f"{path}: there is no such problem file here or in the package; see `vemcvx problems`.")
    return supplied


def copy_lesson(number: int, notebook: bool) -> list[Path]:
    """Copy a lesson and its solutions into the current folder, and return the copies."""
    known = lessons()
    if number not in known:
        raise ProblemError(f"lesson: there is no lesson {number}; there are {', '.join(map(str, known))}.")
    lesson = known[number].path
    files = [lesson, lesson.with_name(f"lesson_{number}_solutions.py")]
    copies = {Path(f"{path.stem}.ipynb" if notebook else path.name): path for path in files}
    for copy in filter(os.path.lexists, copies):
        raise ProblemError(f"lesson: {copy} exists, and no file is overwritten; move it, or go to another folder.")
    for copy, path in copies.items():
        try:
            with copy.open("x", encoding="utf-8") as file:
                text = path.read_text(encoding="utf-8")
                file.write(f"{json.dumps(as_notebook(text), indent=1, ensure_ascii=False)}\n" if notebook else text)
        except OSError as error:
            raise ProblemError(f"lesson: {copy} cannot be written: {error.strerror}; go to another folder.") from error
    return list(copies)


def as_notebook(text: str) -> dict[str, Any]:
    """Return the text of a lesson as a notebook without outputs."""
    first, *rest = re.split(r"^# %%(.*)\n", text, flags=re.MULTILINE)
    made = list[dict[str, Any]]()
    for mark, source in [("", first), *zip(rest[::2], rest[1::2], strict=True)]:
        body, cell = source.strip("\n"), dict[str, Any](cell_type="markdown", metadata={})
        if "[markdown]" not in mark:
            folded = {"jupyter": {"source_hidden": True}} if "source_hidden" in mark else {}
            cell = {"cell_type": "code", "metadata": folded, "execution_count": None, "outputs": []}
        elif body.startswith('"""'):
            body = ast.literal_eval(body)
        else:
            body = re.sub(r"^# ?", "", body, flags=re.MULTILINE)
        if body.strip():
            made.append({**cell, "id": f"cell-{len(made)}", "source": body.splitlines(keepends=True)})
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    about = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": made, "metadata": about, "nbformat": 4, "nbformat_minor": 5}
