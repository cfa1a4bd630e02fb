"""A run warns of large strains, and names the largest strain and the place."""

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
    """The load is 2 MPa. The modulus 2 GPa is entered as 2e3 (in MPa), or wrongly as 2."""

    def pull(young):
        load = vx.Traction([2.0] + [0.0] * (mesh.points.shape[1] - 1), on="right")
        scene = vx.Scene(vx.Elasticity(young, 0.3), vx.Clamp(on="left"), load)
        return vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")

    assert catch_warnings(caplog, lambda: pull(2e3)) == []
    (told,) = catch_warnings(caplog, lambda: pull(2.0))
    found = re.match(r"strains are not small: found ([\d.]+) at \(.*\), t = 0\.", told)
    assert 0.5 < float(found.group(1)) < 2.0
