"""Comparison of meshes to the bit: arrays, names, data and interfaces."""

from __future__ import annotations

import numpy as np


def assert_same(one, other, *, arrays=None, parts=("boundaries", "cell_data")):
    """Check that two meshes of one kind are equal, by default in all arrays and names."""
    assert type(one) is type(other)
    for name in one.ARRAYS if arrays is None else arrays:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for part in parts:
        mine, theirs = getattr(one, part), getattr(other, part)
        assert set(mine) == set(theirs)
        for name, values in mine.items():
            np.testing.assert_array_equal(values, theirs[name])
            assert values.dtype == theirs[name].dtype
    assert {name: of.bodies for name, of in one.interfaces.items()} == {
        n: i.bodies for n, i in other.interfaces.items()
    }
    for name, found in one.interfaces.items():
        np.testing.assert_array_equal(found.edges, other.interfaces[name].edges)
        np.testing.assert_array_equal(found.partners, other.interfaces[name].partners)
