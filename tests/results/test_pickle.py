"""Histories are pickled and copied; a scene whose functions pickle cannot keep is told, with what to do."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import feng_han_huang
import vemcvx as vx


def whole():
    """Constant data alone, which pickle keeps."""
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.Clamp(on="left"), vx.Traction((0.0, 1.0), on="right"))
    return vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0], initial="settled")


def test_what_can_be_kept_is_kept():
    history = whole()
    again = pickle.loads(pickle.dumps(history))
    np.testing.assert_array_equal(again.displacement, history.displacement)
    assert again.effects == history.effects
    assert [effect.describe() for effect in again.scene] == [effect.describe() for effect in history.scene]


@pytest.mark.long
def test_functions_inside_functions_are_told(tmp_path):
    history = vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(3), feng_han_huang.times(2))
    with pytest.raises(vx.HistoryError) as told:
        pickle.dumps(history)
    words = str(told.value)
    assert words.startswith("pickle: Traction: ")
    assert "cannot be pickled (Can't " in words
    assert "pickle keeps functions by their names in a module" in words
    assert "Write the history with history.write(folder) and read it with vemcvx.read_history(folder)" in words
    # What it advises works.
    bare = pickle.loads(pickle.dumps(replace(history, scene=None)))
    history.write(tmp_path)
    for other in (bare, vx.read_history(tmp_path)):
        np.testing.assert_array_equal(other.displacement, history.displacement)
        assert other.scene is None


def test_copies_keep_the_scene():
    history = vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(3), feng_han_huang.times(2))
    for other in (copy.copy(history), copy.deepcopy(history)):
        assert other.scene is history.scene
        np.testing.assert_array_equal(other.displacement, history.displacement)
    assert not np.shares_memory(copy.deepcopy(history).displacement, history.displacement)
