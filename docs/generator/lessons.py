"""Lessons as notebooks for MyST-NB, and the page that lists them."""

from __future__ import annotations

import json
import re
from pathlib import Path

from generator.gallery import list_problems
from vemcvx.cli.supplied import as_notebook, lessons

INDEX = """# Learn

There are eleven lessons for students who know linear algebra and a little of finite elements. Each has formulas, code,
pictures, questions whose answers unfold, and exercises with solutions. `vemcvx lesson N` copies lesson N and its
solutions into your folder. `--notebook` copies them as notebooks.

[](course.md) helps lecturers, and has a table of symbols.

{rows}

```{{toctree}}
:hidden:

course
{pages}
```
"""


def write(folder: Path) -> None:
    """Write the notebooks of all lessons and solutions, and the page `index.md`."""
    folder.mkdir(parents=True, exist_ok=True)
    notebooks = folder.parent / "_static" / "notebooks"
    notebooks.mkdir(parents=True, exist_ok=True)
    rows, pages = [], []
    for number, lesson in lessons().items():
        solutions = lesson.path.with_name(f"lesson_{number}_solutions.py")
        for path, name in ((lesson.path, f"lesson_{number}"), (solutions, f"lesson_{number}_solutions")):
            made = as_notebook(path.read_text(encoding="utf-8"))
            write_if_new(made, notebooks / f"{path.stem}.ipynb")
            for cell in made["cells"]:
                if cell["metadata"]:
                    picture = cell["source"][0].removeprefix("# ").strip()
                    cell["metadata"] |= {"tags": ["hide-input"], "mystnb": {"image": {"alt": picture}}}
                if cell["cell_type"] == "markdown":
                    cell["source"] = [link_files(line, number) for line in cell["source"]]
            if path == lesson.path:
                tree = f"```{{toctree}}\n:hidden:\n\nSolutions <lesson_{number}_solutions>\n```"
                made["cells"].append({"cell_type": "markdown", "id": "solutions", "metadata": {}, "source": tree})
            write_if_new(made, folder / f"{name}.ipynb")
        title = lesson.sentence.removeprefix(f"Lesson {number}, ")
        pages.append(f"Lesson {number}, {title.partition(':')[0]} <lesson_{number}>")
        rows.append(
            f"{number}. [{title[0].upper()}{title[1:]}](lesson_{number}.ipynb)\n"
            f"   ([solutions](lesson_{number}_solutions.ipynb), "
            f'<a href="slides/lesson_{number}.html">slides</a>, '
            f'<a href="../_static/notebooks/{lesson.path.stem}.ipynb" download>notebook</a>)'
        )
    (folder / "index.md").write_text(INDEX.format(rows="\n".join(rows), pages="\n".join(pages)), encoding="utf-8")


def write_if_new(made: dict[str, object], path: Path) -> None:
    """Write a notebook if its text has changed."""
    text = json.dumps(made, indent=1, ensure_ascii=False)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def link_files(line: str, number: int) -> str:
    """Return a line of lesson `number` with links to files."""
    solutions = f"lesson_{number}_solutions"
    line = line.replace(f"`{solutions}.py`", f"[`{solutions}.py`]({solutions}.ipynb)")
    return re.sub(r"`(?:problems/)?(\w+)\.py`", link_problem, line)


def link_problem(found: re.Match[str]) -> str:
    """Return the link to a problem, or other text unchanged."""
    name = found.group(1)
    return f"[`{name}.py`](../gallery/{name}.md)" if name in list_problems() else found.group()
