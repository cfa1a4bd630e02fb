"""Every example in a docstring of the package runs, and prints the output that the docstring shows."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import numpy as np
import pytest

import vemcvx as vx

MODULES = [module.name for module in pkgutil.walk_packages(vx.__path__, "vemcvx.") if "__main__" not in module.name]
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


@pytest.mark.slow
@pytest.mark.parametrize("name", MODULES)
def test_examples_of_docstrings_run(name, tmp_path, monkeypatch):
    """Examples use `np`, `vx` and (for plots) `history` without a definition."""
    monkeypatch.chdir(tmp_path)
    names = {"np": np, "vx": vx}
    if ".plots." in name:
        steel, press = vx.Elasticity(200.0, 0.3), vx.PrescribedDisplacement((0.01, -0.01), on="top")
        scene = vx.Scene(steel, press, vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom"))
        names["history"] = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled")
    assert doctest.testmod(importlib.import_module(name), extraglobs=names, optionflags=FLAGS).failed == 0
