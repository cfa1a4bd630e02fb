"""Assembly in chunks of cells does not change results."""

from __future__ import annotations

import numpy as np

import vemcvx as vx
from vemcvx.vem import Space, stiffness


def test_a_stiffness_matrix_assembled_in_chunks_has_the_same_bits(monkeypatch):
    ones = np.ones(6**3)
    whole = stiffness(Space(vx.meshes.cubes(6)), ones, ones)
    monkeypatch.setattr("vemcvx.vem.projection.CHUNK_SIZE", 50)
    chunked = stiffness(Space(vx.meshes.cubes(6)), ones, ones)
    assert all(np.array_equal(getattr(whole, part), getattr(chunked, part)) for part in ("data", "indices", "indptr"))
