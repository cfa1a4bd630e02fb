"""Histories are pickled and copied; scenes as far as their functions allow it."""

import copy
import pickle
from dataclasses import replace

import numpy as np

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


def test_without_its_scene_a_history_can_be_kept(tmp_path):
    history = vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(3), feng_han_huang.times(2))
    bare = pickle.loads(pickle.dumps(replace(history, scene=None)))
    history.write(tmp_path)
    for other in (bare, vx.read_history(tmp_path)):
        np.testing.assert_array_equal(other.displacement, history.displacement)
        assert other.scene is None


def test_copies_are_their_own():
    history = vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(3), feng_han_huang.times(2))
    assert copy.copy(history).scene is history.scene
    other = copy.deepcopy(history)
    np.testing.assert_array_equal(other.displacement, history.displacement)
    assert not np.shares_memory(other.displacement, history.displacement)
