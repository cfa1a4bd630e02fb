"""A warning where small strains are left: the largest one and its place; and none where they are small."""

import importlib
import logging
import re
from pathlib import Path

import numpy as np
import pytest

import feng_han_huang
import gallery
import vemcvx as vx

PROBLEMS = sorted(path.stem for path in Path(gallery.__file__).parent.glob("*.py"))
LONG = {
    "twisted_pad",
    "bolted_flange",
    "block_dragged_along_a_curve",
    "brake_pad_on_disc",
    "cattaneo_mindlin",
    "spherical_indenter",
}
FORMAL = {"manufactured_full_slip"}
"""Problems whose docstring says that a run warns about their strains."""


def said(caplog, run):
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        caplog.clear()
        run()
    return [r.getMessage() for r in caplog.records if "strains are not small" in r.getMessage()]


def pulled(young, mesh=None):
    pull = [2.0] + [0.0] * (1 if mesh is None else 2)
    scene = vx.Scene(vx.Elasticity(young, 0.3), vx.Clamp(on="left"), vx.Traction(pull, on="right"))
    return vx.simulate(scene, mesh or vx.meshes.squares(8), [0.0, 1.0], initial="settled")


@pytest.mark.parametrize("mesh", [None, vx.meshes.cubes(3)], ids=["plane", "space"])
def test_young_in_other_units_than_loads(caplog, mesh):
    """A strain of a thousandth is small, and one: GPa for MPa."""
    assert said(caplog, lambda: pulled(2e3, mesh)) == []
    (told,) = said(caplog, lambda: pulled(2.0, mesh))
    found = re.fullmatch(
        r"strains are not small: found ([\d.]+) at \(.*\), t = 0\. The linear model does not hold there; "
        r"compare the units of stiffness, loads, supports and mesh\.",
        told,
    )
    assert 0.5 < float(found.group(1)) < 2.0


def test_a_body_that_is_carried_far_does_not_strain(caplog):
    """It slides on a rigid floor as far as it likes."""

    def run():
        carried = vx.PrescribedDisplacement(lambda x, t: np.tile([5.0 * t, -0.001], (len(x), 1)), on="top")
        floor = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom")
        scene = vx.Scene(vx.Elasticity(100.0, 0.3), carried, *floor)
        vx.simulate(scene, vx.meshes.squares(4), np.linspace(0.0, 1.0, 3), initial="settled")

    assert said(caplog, run) == []


@pytest.mark.long
def test_corners_of_fine_meshes_do_not_count(caplog):
    """Near a singular corner a strain is large if only the mesh is fine: of less than a hundredth of the body."""
    scene, times = feng_han_huang.scene(), feng_han_huang.times(1)
    history = vx.simulate(scene, vx.meshes.squares(48), times)
    assert history.von_mises(-1).max() > 0.05 * 200.0
    assert said(caplog, lambda: vx.simulate(scene, vx.meshes.squares(48), times)) == []


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in PROBLEMS]
)
def test_problem_files_warn_where_they_say_so(caplog, name):
    problem = importlib.import_module(name)
    if not all(hasattr(problem, part) for part in ("scene", "mesh", "times")):
        return
    found = said(caplog, lambda: gallery.small_run(problem))
    assert bool(found) == (name in FORMAL)
    if found:
        assert "a run warns about them" in problem.__doc__
