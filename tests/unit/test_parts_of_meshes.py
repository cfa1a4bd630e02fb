"""What is done for a part of the cells at a time, or looked at in a part of them."""

from __future__ import annotations

import logging

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.vem import Space, stiffness


def said(caplog, run):
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        caplog.clear()
        run()
    return [r.getMessage() for r in caplog.records if "strains are not small" in r.getMessage()]


@pytest.mark.long
def test_some_cells_of_many_are_looked_at(caplog, monkeypatch):
    """Two columns of soft cells are a sixteenth of the body: every sixteenth cell shows them."""
    mesh = vx.meshes.squares(32)
    soft = np.where(np.arange(mesh.n_cells) % 32 < 2, 1.0, 1e3)  # Cells are numbered along the rows.
    scene = vx.Scene(vx.Elasticity(soft, 0.0), vx.Clamp(on="left"), vx.Traction((0.3, 0.0), on="right"))
    told = []
    for some in (64, 4096):
        monkeypatch.setattr("vemcvx.results.results.CHUNK_SIZE", some)
        told += said(caplog, lambda: vx.simulate(scene, mesh, [0.0, 1.0], initial="settled"))
    assert len(told) == 2
    assert all("found 0.3 at (0.0" in one for one in told)


def test_rows_made_a_few_at_a_time_have_the_bits_of_all(monkeypatch):
    space, ones = Space(vx.meshes.cubes(6)), np.ones(6**3)
    whole = stiffness(space, ones, ones)
    monkeypatch.setattr("vemcvx.vem.elasticity.CHUNK_SIZE", 50)
    some = stiffness(space, ones, ones)
    assert all(np.array_equal(getattr(whole, part), getattr(some, part)) for part in ("data", "indices", "indptr"))
