"""Write the reference of all public names, from docstrings, as web pages: python .ci/reference.py FOLDER."""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from dataclasses import is_dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_type_hints
from unittest.mock import MagicMock

import pdoc.doc
import pdoc.render

# This checkout is described, whatever is installed, and its tests for everybody without pytest, which only runs them.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
if find_spec("pytest") is None:
    sys.modules["pytest"] = MagicMock()
PARTS = "estimate.measures", "plots", "program", "effects", "vem", "testing"
# The modules of single pictures have the names of their functions, which are on the page of `plots`.
MODULES = "vemcvx", *(f"vemcvx.{part}" for part in PARTS), "!vemcvx.plots."
spelt_out = inspect.formatannotation
SHORT = {
    r"(?<![\w.])typing\.": "",
    r"numpy\._typing\._array_like\._Buffer, .*?, complex, bytes, str, .*?\[complex \| bytes \| str\]": "ArrayLike",
    r"Union\[ArrayLike\]": "ArrayLike",
    r"Union\[([^\[\]]+), NoneType\]": r"\1 | None",
    r"numpy\.ndarray\[tuple\[Any, \.\.\.\], numpy\.dtype\[numpy\.(\w+)\]\]": r"NDArray[\1]",
    r"Annotated\[(.*?)(, '[^']*')+\]": r"\1",
    r"scipy\.sparse\._\w+\.": "scipy.sparse.",
}


def in_short(annotation: Any, *given: Any, **named: Any) -> str:
    """An annotation by the names that it was written with: Python has forgotten those of unions and arrays."""
    words = spelt_out(annotation, *given, **named)
    for long, short in SHORT.items():
        words = re.sub(long, short, words)
    return words


def with_inherited_types(kind: type) -> None:
    """Say the types of a record's fields as the modules of its bases know them: pdoc looks in its own module alone."""
    types, given = get_type_hints(kind, include_extras=True), kind.__init__.__annotations__
    given.update({name: types[name] for name in given if name in types})


for kind in vars(importlib.import_module("vemcvx")).values():
    if isinstance(kind, type) and is_dataclass(kind):
        with_inherited_types(kind)
inspect.formatannotation = pdoc.doc.formatannotation = in_short
pdoc.render.configure(docformat="numpy")
pdoc.pdoc(*MODULES, output_directory=Path(sys.argv[1]))
