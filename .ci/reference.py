"""Write the reference of all public names, from docstrings, as web pages: python .ci/reference.py FOLDER."""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path
from typing import Any

import pdoc.doc
import pdoc.render

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


inspect.formatannotation = pdoc.doc.formatannotation = in_short
pdoc.render.configure(docformat="numpy")
pdoc.pdoc(*MODULES, output_directory=Path(sys.argv[1]))
