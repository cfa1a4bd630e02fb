"""Straight sides with rounded coordinates, and polygonal sides that approximate a curve."""

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx

ANGLE = 0.7
TURN = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])


def block(rounded=lambda x: x, n=8):
    """Return a rotated square with rounded coordinates. The bottom has the parts a and b."""
    square = vx.meshes.squares(n)
    bottom = np.asarray(square.boundaries["bottom"])
    left = square.points[bottom].mean(axis=1)[:, 0] < 0.5
    sides = {"a": bottom[left], "b": bottom[~left], "top": np.asarray(square.boundaries["top"])}
    return vx.PolygonMesh(rounded(square.points @ TURN.T), [list(c) for c in square.cells], boundaries=sides)


@pytest.mark.parametrize("digits", [4, 9])
def test_rounding_of_points_changes_displacements_in_proportion_to_the_rounding(digits):
    """Rounding errors e of coordinates rotate sides by up to 2 e / h = 16 e."""

    def displacement(mesh):
        load = vx.Traction(lambda x, t: np.tile(TURN @ [0.8 * t, -2 * t], (len(x), 1)), on="top")
        contact = [effect for on in "ab" for effect in (vx.UnilateralContact(on=on), vx.CoulombFriction(0.3, on=on))]
        scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.ElasticFoundation(5.0, 5.0, on="top"), load, *contact)
        return vx.simulate(scene, mesh, [0, 0.5, 1]).displacement[-1] @ TURN

    exact, mesh = displacement(block()), block(lambda x: np.round(x, digits))
    rounding = np.abs(mesh.points - block().points).max()
    assert np.abs(displacement(mesh) - exact).max() <= 100 * rounding * np.abs(exact).max()


HOUSINGS = {
    "one-sided": vx.UnilateralContact(on="outer"),
    "with a gap": vx.UnilateralContact(on="outer", gap=0.001),
    "compliant": vx.NormalCompliance(1e4, on="outer"),
    "bilateral": vx.BilateralContact(on="outer"),
    "rollers": vx.Symmetry(on="outer"),
}


def swollen(x, t):
    """Return the motion of the inner side: an expansion, then a rotation."""
    return 0.02 * min(t, 1) * x + 0.05 * max(t - 1, 0) * np.column_stack([-x[:, 1], x[:, 0]])


@mostly_long("housing", HOUSINGS, "one-sided", "compliant", "rollers")
@mostly_long("sides", [12, 24], 1)
def test_a_ring_turns_in_a_frictionless_housing(housing, sides):
    """Each node has one mean normal. With the normals of the sides, the ring would jam."""
    mesh = vx.meshes.ring([1.0, 1.5, 2.0], sides)
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.PrescribedDisplacement(swollen, on="inner"), HOUSINGS[housing])
    history = vx.simulate(scene, mesh, [0, 1, 2])
    at, forces = np.hypot(*mesh.points.T) > 1.9, history.forces[-1]
    x, f = mesh.points[at], forces[at]
    torque, pressing = (x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]).sum(), -(x * f).sum()
    assert abs(torque) <= 1e-8 * pressing


@pytest.mark.long
@pytest.mark.parametrize("housing", HOUSINGS)
def test_adapting_along_a_curve_causes_a_warning(housing):
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.PrescribedDisplacement(swollen, on="inner"), HOUSINGS[housing])
    with pytest.warns(vx.SceneWarning, match=r"^adapt: .* on outer is a polygon .* finer meshes of the curve"):
        vx.adapt(scene, vx.meshes.ring([1.0, 1.5, 2.0], 12), [0.0, 1.0], 0.3)
