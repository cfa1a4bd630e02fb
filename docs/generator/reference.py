"""The public names on the pages of `docs/reference`."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from pkgutil import resolve_name

PAGES = Path(__file__).resolve().parents[1] / "reference"
ENTRY = re.compile(r"^(?: {3}|\.\. (?:py:data|automodule):: )(vemcvx(?:\.\w+)+)$", re.MULTILINE)
OBJECTS = {name: resolve_name(name) for page in sorted(PAGES.glob("*.md")) for name in ENTRY.findall(page.read_text())}
"""The objects with an entry on a page of the reference, by their full names."""
SHORT = {name.rpartition(".")[2]: name for name, thing in OBJECTS.items() if not inspect.ismodule(thing)}
