"""Lessons as notebooks for MyST-NB, and the page that lists them."""

from __future__ import annotations

import json
import re
from pathlib import Path

from generator.gallery import list_problems
from vemcvx.cli.supplied import as_notebook, lessons

INDEX = """# Learn

Lessons for students who know linear algebra and a little of finite elements: formula, code, picture, questions whose
answers unfold, exercises with solutions. `vemcvx lesson N` copies lesson N and its solutions into your folder, with
`--notebook` as notebooks, with `--no-solutions` the lesson alone, for homework.

How to teach with them: [](course.md).

{rows}

```{{toctree}}
:hidden:

course
{pages}
```
"""


def write(folder: Path) -> None:
    """Write `lesson_N.ipynb` and `lesson_N_solutions.ipynb`, which MyST-NB runs, and the page that lists them."""
    folder.mkdir(parents=True, exist_ok=True)
    notebooks = folder.parent / "_static" / "notebooks"
    notebooks.mkdir(parents=True, exist_ok=True)
    rows, pages = [], []
    for number, lesson in lessons().items():
        solutions = lesson.path.with_name(f"lesson_{number}_solutions.py")
        for path, name in ((lesson.path, f"lesson_{number}"), (solutions, f"lesson_{number}_solutions")):
            made = as_notebook(path.read_text(encoding="utf-8"))
            _kept(made, notebooks / f"{path.stem}.ipynb")
            for cell in made["cells"]:
                if cell["metadata"]:
                    cell["metadata"]["tags"] = ["hide-input"]
                if cell["cell_type"] == "markdown":
                    cell["source"] = [_linked(line, number) for line in cell["source"]]
            if path == lesson.path:
                made["cells"].append(_below(number))
            _kept(made, folder / f"{name}.ipynb")
        title = lesson.sentence.removeprefix(f"Lesson {number}, ")
        pages.append(f"Lesson {number}, {title.partition(':')[0]} <lesson_{number}>")
        rows.append(
            f"{number}. [{title[0].upper()}{title[1:]}](lesson_{number}.ipynb)\n"
            f"   ([solutions](lesson_{number}_solutions.ipynb), "
            f'<a href="slides/lesson_{number}.html">slides</a>, '
            f'<a href="../_static/notebooks/{lesson.path.stem}.ipynb" download>notebook</a>)'
        )
    (folder / "index.md").write_text(INDEX.format(rows="\n".join(rows), pages="\n".join(pages)), encoding="utf-8")


def _kept(made: dict[str, object], path: Path) -> None:
    """Write a notebook, unless it is there: its cells need not be run again."""
    text = json.dumps(made, indent=1, ensure_ascii=False)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def _below(number: int) -> dict[str, object]:
    """A cell that puts the solutions below their lesson in the list of pages."""
    tree = f"```{{toctree}}\n:hidden:\n\nSolutions <lesson_{number}_solutions>\n```"
    return {"cell_type": "markdown", "id": "solutions", "metadata": {}, "source": tree.splitlines(keepends=True)}


def _linked(line: str, number: int) -> str:
    """A line of a lesson in which the file of its solutions, and problem files, are links."""
    solutions = f"lesson_{number}_solutions"
    line = line.replace(f"`{solutions}.py`", f"[`{solutions}.py`]({solutions}.ipynb)")
    return re.sub(r"`(?:problems/)?(\w+)\.py`", lambda found: _problem(found.group(1)) or found.group(), line)


def _problem(name: str) -> str | None:
    return f"[`{name}.py`](../gallery/{name}.md)" if name in list_problems() else None
