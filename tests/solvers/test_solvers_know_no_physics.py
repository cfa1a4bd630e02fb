"""The solvers answer Problem 2.1 for anybody: their source does not speak of what it is about."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import vemcvx

SOLVERS = sorted((Path(vemcvx.__file__).parent / "solvers").glob("*.py"))
WORDS = re.compile(r"\b(contact\w*|friction\w*|normals?|tangent\w*)\b", re.IGNORECASE)


@pytest.mark.parametrize("path", SOLVERS, ids=lambda path: path.name)
def test_a_solver_does_not_know_what_it_solves(path):
    found = [f"{n}: {line.strip()}" for n, line in enumerate(path.read_text().splitlines(), 1) if WORDS.search(line)]
    assert not found, f"{path.name} speaks of the physics:\n" + "\n".join(found)
