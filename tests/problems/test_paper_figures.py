"""The paper's figures and table by one command, in a small setting."""

from __future__ import annotations

import importlib
import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.fixture
def figures(monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(PROBLEMS)
    return importlib.import_module("paper_figures")


@pytest.mark.long
def test_one_command(figures, tmp_path):
    text = io.StringIO()
    console = Console(file=text, width=140)
    figures.main(tmp_path, sizes=(4, 8), reference=32, n=6, steps=4, counts=(50, 200), console=console)
    for number in (1, 2, 3, 4):
        assert (tmp_path / f"paper_figure_{number}.png").read_bytes().startswith(b"\x89PNG")
    printed = text.getvalue()
    for fact in ("0.1745", "0.0911", "0.94", "99", "121", "nonconvex: 36 cells"):
        assert fact in printed


@pytest.mark.long
def test_table_1_in_small(figures):
    """Against h = 1/32 instead of 1/256; steps cost nothing, and the nodal distance is the least."""
    found = figures.errors((4, 8), 32)
    relative = {kind: [one.relative for one in found[kind]] for kind in found}
    assert relative["exact"] == pytest.approx([0.189838, 0.103589], rel=1e-5)
    assert max(relative["in time"]) < 1e-8
    assert (np.array(relative["nodal"]) < relative["exact"]).all()


@pytest.mark.long
def test_fig_4_triangles_to_the_node(figures):
    """The paper's triangles are ours; polygons that nobody collapses have 2 n + 2 nodes."""
    for count, fewest, most, whole, triangles, _ in figures.nodes((50, 200), seeds=3):
        assert triangles == figures.PRINTED_NODES[count][1]
        assert whole == 2 * count + 2
        assert 0.97 * whole < fewest <= most <= whole
