"""A run warns if and only if its strains are not small; the warning gives the largest strain and its place."""

import logging
import re

import pytest

import vemcvx as vx


def catch_warnings(caplog, run):
    """Return the warnings about large strains that a run logs."""
    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        caplog.clear()
        run()
    return [r.getMessage() for r in caplog.records if "strains are not small" in r.getMessage()]


@pytest.mark.parametrize("mesh", [vx.meshes.squares(8), vx.meshes.cubes(3)], ids=["plane", "space"])
def test_a_modulus_in_wrong_units_is_noticed(caplog, mesh):
    """Under a load of 2 MPa, the strain is .001 with a modulus of 2e3 MPa; with 2 GPa, entered as 2, it is 1."""

    def pull(young):
        load = vx.Traction([2.0] + [0.0] * (mesh.points.shape[1] - 1), on="right")
        scene = vx.Scene(vx.Elasticity(young, 0.3), vx.Clamp(on="left"), load)
        return vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")

    assert catch_warnings(caplog, lambda: pull(2e3)) == []
    (told,) = catch_warnings(caplog, lambda: pull(2.0))
    found = re.match(r"strains are not small: found ([\d.]+) at \(.*\), t = 0\.", told)
    assert 0.5 < float(found.group(1)) < 2.0
