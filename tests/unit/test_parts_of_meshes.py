"""Chunks of cells do not change results, and checks of strains read a sample of cells."""

from __future__ import annotations

import logging

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.vem import Space, stiffness


@pytest.mark.long
def test_a_sample_of_cells_suffices_to_warn_of_large_strains(caplog, monkeypatch):
    """Two soft columns are a sixteenth of the body. In chunks of 64 cells, every seventeenth cell is checked."""
    mesh = vx.meshes.squares(32)
    soft = np.where(np.arange(mesh.n_cells) % 32 < 2, 1.0, 1e3)  # Cells are numbered along the rows.
    scene = vx.Scene(vx.Elasticity(soft, 0.0), vx.Clamp(on="left"), vx.Traction((0.3, 0.0), on="right"))
    for size in (64, 4096):
        monkeypatch.setattr("vemcvx.results.results.CHUNK_SIZE", size)
        caplog.clear()
        with caplog.at_level(logging.WARNING, logger="vemcvx"):
            vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
        (message,) = [r.getMessage() for r in caplog.records if "strains are not small" in r.getMessage()]
        assert "found 0.3 at (0.0" in message


def test_a_stiffness_matrix_assembled_in_chunks_has_the_same_bits(monkeypatch):
    space, ones = Space(vx.meshes.cubes(6)), np.ones(6**3)
    whole = stiffness(space, ones, ones)
    monkeypatch.setattr("vemcvx.vem.elasticity.CHUNK_SIZE", 50)
    chunked = stiffness(space, ones, ones)
    assert all(np.array_equal(getattr(whole, part), getattr(chunked, part)) for part in ("data", "indices", "indptr"))
