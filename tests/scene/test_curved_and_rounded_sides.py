"""Sides that are straight but for the digits of their points, and sides that approximate a curve."""

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx

ROUNDED = {"float32": lambda x: x.astype(np.float32).astype(float), "6 digits": lambda x: np.round(x, 6)}
ROUNDED |= {f"{k} digits": lambda x, k=k: np.round(x, k) for k in (4, 8, 9, 10)}
LAWS = {
    "symmetry": lambda a, b: [vx.Symmetry(on=a), vx.Symmetry(on=b)],
    "bilateral": lambda a, b: [vx.BilateralContact(on=[a, b])],
    "Tresca": lambda a, b: [vx.BilateralContact(on=[a, b]), vx.TrescaFriction(0.3, on=a), vx.TrescaFriction(0.2, on=b)],
    "Coulomb": lambda a, b: [
        vx.UnilateralContact(on=a),
        vx.UnilateralContact(on=b),
        vx.CoulombFriction(0.3, on=[a, b]),
    ],
    "compliant": lambda a, b: [
        vx.NormalCompliance(1e3, on=a),
        vx.UnilateralContact(on=b),
        vx.CoulombFriction(0.3, on=[a, b]),
    ],
    "moved": lambda a, b: [
        vx.PrescribedDisplacement(lambda x, t: 0.01 * t, on=a, direction="normal"),
        vx.PrescribedDisplacement(lambda x, t: 0.01 * t, on=b, direction="normal"),
    ],
}
ANGLE = 0.7
TURN = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])


def block(rounded=lambda x: x, n=8):
    """A square turned, whose points are rounded; its bottom is named in two parts."""
    square = vx.meshes.squares(n)
    bottom = np.asarray(square.boundaries["bottom"])
    left = square.points[bottom].mean(axis=1)[:, 0] < 0.5
    sides = {"a": bottom[left], "b": bottom[~left], "top": np.asarray(square.boundaries["top"])}
    return vx.PolygonMesh(rounded(square.points @ TURN.T), [list(c) for c in square.cells], boundaries=sides)


def pushed(mesh, law):
    """Displacements along the turned axes."""
    load = vx.Traction(lambda x, t: np.tile(TURN @ [0.8 * t, -2 * t], (len(x), 1)), on="top")
    body = vx.Elasticity(100.0, 0.3), vx.ElasticFoundation(5.0, 5.0, on="top"), load
    return vx.simulate(vx.Scene(*body, *LAWS[law]("a", "b")), mesh, [0, 0.5, 1]).displacement[-1] @ TURN


@pytest.mark.long
@pytest.mark.parametrize("law", LAWS)
def test_rounded_points_change_no_more_than_they_are_rounded(law):
    """Sides are turned by up to 2 n times what points are; a hundred times that is granted for slip that goes on."""
    exact = pushed(block(), law)
    for name, rounded in ROUNDED.items():
        by = np.abs(block(rounded).points - block().points).max()
        change = np.abs(pushed(block(rounded), law) - exact).max() / np.abs(exact).max()
        assert change <= 100 * by, name


def test_a_face_in_space_slides_whatever_its_points_are_rounded_to():
    turn = np.array([[np.cos(0.3), 0, -np.sin(0.3)], [0, 1, 0], [np.sin(0.3), 0, np.cos(0.3)]])
    cubes = vx.meshes.cubes(2)

    def moved(rounded):
        mesh = vx.PolyhedralMesh(rounded(cubes.points @ turn.T), [[list(f) for f in c] for c in cubes.cells])
        mesh = mesh.with_boundary("bottom", lambda x: (x @ turn)[:, 2] < 1e-3)
        mesh = mesh.with_boundary("top", lambda x: (x @ turn)[:, 2] > 1 - 1e-3)
        scene = vx.Scene(
            vx.Elasticity(100.0, 0.3),
            vx.ElasticFoundation(5.0, 5.0, on="top"),
            vx.Traction(lambda x, t: np.tile(turn @ [0.8 * t, 0, -2 * t], (len(x), 1)), on="top"),
            vx.Symmetry(on="bottom"),
        )
        return vx.simulate(scene, mesh, [0, 1]).displacement[-1]

    exact = moved(lambda x: x)
    assert np.abs(moved(ROUNDED["float32"]) - exact).max() <= 1e-5 * np.abs(exact).max()


def ring(nt, inner=1.0, outer=2.0, layers=2, uneven=False):
    """A polygon of nt sides with a hole; where they are uneven, every second one is three times as long."""
    steps = np.where(np.arange(nt) % 2, 3.0, 1.0) if uneven else np.ones(nt)
    angles = 2 * np.pi * np.cumsum(steps) / steps.sum()
    circles = [r * np.column_stack([np.cos(angles), np.sin(angles)]) for r in np.linspace(inner, outer, layers + 1)]
    cells = [
        [i * nt + j, (i + 1) * nt + j, (i + 1) * nt + (j + 1) % nt, i * nt + (j + 1) % nt]
        for i in range(layers)
        for j in range(nt)
    ]
    mesh = vx.PolygonMesh(np.concatenate(circles), cells)
    mesh = mesh.with_boundary("inner", lambda x: np.hypot(*x.T) < inner + 0.1)
    return mesh.with_boundary("outer", lambda x: np.hypot(*x.T) > outer - 0.2)


HOUSINGS = {
    "one-sided": vx.UnilateralContact(on="outer"),
    "with a gap": vx.UnilateralContact(on="outer", gap=0.001),
    "compliant": vx.NormalCompliance(1e4, on="outer"),
    "bilateral": vx.BilateralContact(on="outer"),
    "rollers": vx.Symmetry(on="outer"),
}


def swollen(x, t):
    """Expanded first, then turned."""
    return 0.02 * min(t, 1) * x + 0.05 * max(t - 1, 0) * np.column_stack([-x[:, 1], x[:, 0]])


@mostly_long("housing", HOUSINGS, "one-sided", "compliant", "rollers")
@mostly_long("nt, uneven", [(12, False), (24, False), (24, True)], 2)
def test_a_ring_turns_in_a_frictionless_housing(housing, nt, uneven):
    """Its nodes would have to climb the corners of the housing, were both normals of each held."""
    mesh = ring(nt, uneven=uneven)
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.PrescribedDisplacement(swollen, on="inner"), HOUSINGS[housing])
    history = vx.simulate(scene, mesh, [0, 1, 2])
    at, forces = np.hypot(*mesh.points.T) > 1.9, history.forces[-1]
    x, f = mesh.points[at], forces[at]
    torque, pressing = (x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0]).sum(), -(x * f).sum()
    assert abs(torque) <= (1e-4 * 2 * np.pi / nt if uneven else 1e-8) * pressing


@pytest.mark.long
@pytest.mark.parametrize("nt", [65, 90])
@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_newton_answers_in_a_round_housing(nt, friction):
    """Uniform pressure: gap zero everywhere, so that d = 0 outside, and Clarabel agrees."""
    scene = vx.Scene(
        vx.Elasticity(100.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: 0.02 * t * x, on="inner"),
        vx.UnilateralContact(on="outer"),
        vx.CoulombFriction(friction, on="outer"),
    )
    newton, clarabel = (vx.simulate(scene, ring(nt), [0, 1], solver=s) for s in (None, vx.Clarabel()))
    assert np.abs(newton.displacement[-1] - clarabel.displacement[-1]).max() <= 1e-5 * np.abs(newton.displacement).max()


@pytest.mark.long
@pytest.mark.parametrize("housing", HOUSINGS)
def test_adapting_along_a_curve_is_warned_of(housing):
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.PrescribedDisplacement(swollen, on="inner"), HOUSINGS[housing])
    with pytest.warns(vx.SceneWarning, match=r"^adapt: .* on outer is a polygon .* finer meshes of the curve"):
        vx.adapt(scene, ring(12), [0.0, 1.0], 0.3)
