"""Lessons as notebooks: Python files with cells, as jupytext's percent format has them, in the format of Jupyter.

The format is nbformat 4.5, https://nbformat.readthedocs.io/en/latest/format_description.html.
"""

from __future__ import annotations

import ast
import json
import re
from typing import Any

MARK = re.compile(r"^# %%(.*)\n", re.MULTILINE)
FOLDED = {"jupyter": {"source_hidden": True}}


def cells(text: str) -> list[tuple[str, str, bool]]:
    """Kind ("markdown" or "code"), source and whether it is folded, of every cell of a file with cells."""
    first, *rest = MARK.split(text)
    marked = [("", first), *zip(rest[::2], rest[1::2], strict=True)]
    return [_cell(mark, source.strip("\n")) for mark, source in marked if source.strip()]


def _cell(mark: str, source: str) -> tuple[str, str, bool]:
    if "[markdown]" not in mark:
        return "code", source, "source_hidden" in mark
    if source.startswith('"""'):
        return "markdown", ast.literal_eval(source), False
    return "markdown", re.sub(r"^# ?", "", source, flags=re.MULTILINE), False


def notebook(text: str) -> dict[str, Any]:
    """Return a file with cells as a notebook, without outputs; what only draws is folded."""
    made = []
    for number, (kind, source, folded) in enumerate(cells(text)):
        cell: dict[str, Any] = {"cell_type": kind, "id": f"cell-{number}", "metadata": dict(FOLDED) if folded else {}}
        if kind == "code":
            cell |= {"execution_count": None, "outputs": []}
        made.append(cell | {"source": source.splitlines(keepends=True)})
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    about = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return {"cells": made, "metadata": about, "nbformat": 4, "nbformat_minor": 5}


def as_notebook(text: str) -> str:
    """Return a file with cells as the text of an .ipynb file."""
    return json.dumps(notebook(text), indent=1, ensure_ascii=False) + "\n"
