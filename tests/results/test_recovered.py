"""On meshes that do not match, recovered pressure and friction have no ripples, and keep the total forces."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scenes import small

import hertz_two_cylinders as cylinders
import vemcvx as vx
from vemcvx.results.contact_tiles import ContactTiles
from vemcvx.scene import pose_scene

COULOMB = (vx.CoulombFriction(0.3, on="lower|upper"),)


def run_joint(families, counts, friction=(), shear=0.0):
    """Press one block on another; return contact, and the order of contact nodes along x."""

    def top(x, t):
        return np.column_stack([np.full(len(x), shear * t), -t * (1 + 0.5 * np.cos(np.pi * x[:, 0] / 2))])

    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="lower.bottom"),
        vx.Symmetry(on=["lower.left", "lower.right", "upper.left", "upper.right"]),
        vx.Traction(top, on="upper.top"),
        vx.UnilateralContact(on="lower|upper"),
        *friction,
    )
    (lower, upper), (n, m) = (getattr(vx.meshes, family) for family in families), counts
    parts = {"lower": lower(n, box=((0, 2), (0, 1))), "upper": upper(m, box=((0, 2), (1, 2)), seed=1)}
    contact = vx.simulate(scene, vx.meshes.bodies(parts), [0.0, 1.0]).contact
    return contact, np.argsort(contact.points[:, 0])


@cache
def reference(friction):
    """Return places, pressure and friction on matching meshes of 64 x 64 squares."""
    contact, order = run_joint(("squares",) * 2, (64, 64), COULOMB * friction, shear=0.1 * friction)
    return contact.points[order, 0], contact.pressure[-1, order], contact.traction[-1, order, 0]


@pytest.mark.long
@pytest.mark.parametrize(
    ("families", "friction", "bound"),
    [
        (("squares", "squares"), True, 0.003),
        (("triangles", "triangles"), False, 0.015),
        (("squares", "voronoi"), True, 0.006),
    ],
    ids=["squares", "triangles", "squares-voronoi"],
)
def test_recovered_pressure_has_no_ripple(families, friction, bound):
    """Errors are relative to the median pressure 1. For n = 16, nodal forces have ripples of .5 to 3.7 %."""
    x, p, q = reference(friction)
    errors = {"raw": [], "recovered": [], "friction": []}
    for n in (8, 16, 32):
        contact, order = run_joint(families, (n, 5 * n // 4), COULOMB * friction, shear=0.1 * friction)
        at = contact.points[order, 0]
        for name, values, exact in (
            ("raw", contact.pressure, p),
            ("recovered", contact.pressure_recovered, p),
            ("friction", contact.traction_recovered[:, :, 0], q),
        ):
            errors[name].append(np.abs(values[-1, order] - np.interp(at, x, exact))[1:-1].max())
        assert contact.pressure_recovered @ contact.lengths == pytest.approx(contact.pressure @ contact.lengths)
    assert errors["recovered"][1] < bound
    assert errors["recovered"][2] < 0.01
    for name in ("recovered", "friction") if friction else ("recovered",):
        assert errors[name][2] < 0.62**2 * errors[name][0], errors
    assert all(fine < 0.62 * raw for fine, raw in zip(errors["recovered"], errors["raw"], strict=True)), errors


@pytest.mark.long
def test_the_pressure_of_hertz_is_smoothed_at_the_edge_of_contact_only():
    """The error is below 2 % of the peak, except in four cells at the edge of contact."""
    errors = []
    for n in (8, 16, 32):
        history = vx.simulate(cylinders.scene(), cylinders.mesh(n), [0.0, 1.0])
        contact, force = history.contact, cylinders.force(history)[-1]
        a, peak = cylinders.hertz(force)
        x, smooth, closed = contact.points[:, 0], contact.pressure_recovered[-1], contact.closed[-1]
        exact = peak * np.sqrt(np.maximum(1 - (x / a) ** 2, 0))
        assert smooth.min() >= 0
        assert (smooth[~closed] == contact.pressure[-1, ~closed]).all()
        assert smooth @ contact.lengths == pytest.approx(0.5 * force, rel=1e-12)
        inside = x < x[closed].max() - 4.0 * contact.lengths[closed].max()
        assert np.abs(smooth - exact)[inside].max() < 0.02 * peak
        errors.append(np.sqrt((smooth - exact) ** 2 @ contact.lengths / a) / peak)
    assert errors[2] < 0.4 * errors[0]


@pytest.mark.parametrize("counts", [(4, 4), (4, 8), (8, 4), (4, 6)])
def test_only_meshes_that_do_not_match_are_averaged(counts):
    contact, _ = run_joint(("squares", "squares"), counts, COULOMB, shear=0.1)
    for raw, recovered in (
        (contact.pressure, contact.pressure_recovered),
        (contact.traction, contact.traction_recovered),
    ):
        assert (np.abs(raw - recovered).max() == 0.0) == (counts[0] == counts[1])
    assert contact.pressure_recovered @ contact.lengths == pytest.approx(contact.pressure @ contact.lengths, rel=1e-12)


def stack_bodies(angle):
    """Return a Voronoi body on a larger body, in the plane or (with `angle`) in space."""
    if angle is None:
        lower = vx.meshes.triangles(6, box=((-1, 2), (-1, 0)))
        return vx.meshes.bodies({"lower": lower, "upper": small("voronoi", 8, box=((0, 1), (0, 1)))})
    c, s = np.cos(angle), np.sin(angle)
    lower = vx.meshes.cubes(2, box=((-1, 2), (-1, 2), (-1, 0)))
    upper = vx.meshes.voronoi3(3, box=((0, 1), (0, 1), (0, 1)))
    upper = vx.PolyhedralMesh(upper.points @ [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]], upper.cells)
    return vx.meshes.bodies({"lower": lower, "upper": upper})


@pytest.mark.long
@pytest.mark.parametrize(("closed_below", "angle"), [(2.0, None), (0.6, None), (0.6, 0.3)])
def test_averages_keep_constants_resultants_and_signs(closed_below, angle):
    """Contact is closed where x_1 < `closed_below`."""
    mesh = stack_bodies(angle)
    held = vx.Clamp(on=["lower.bottom", "upper.top"])
    surface = pose_scene(vx.Scene(vx.Elasticity(1.0, 0.3), held, vx.UnilateralContact(on="lower|upper")), mesh).surface
    tiles, lengths = ContactTiles.from_rows(surface, np.arange(len(surface)), surface, mesh), surface.lengths
    closed = mesh.points[surface.nodes, 0] < closed_below
    forces = np.array([lengths, np.random.default_rng(1).exponential(1.0, len(lengths)) ** 3]) * closed
    found = tiles.average(forces, lengths, np.tile(closed, (2, 1)))
    assert np.abs(found[0] - closed).max() < 1e-12
    assert (found[:, closed] > 0).all()
    assert (found[:, ~closed] == 0).all()
    assert found @ lengths == pytest.approx(forces.sum(axis=1), rel=1e-12)
    assert np.ptp(found[1, closed]) < 0.3 * np.ptp(forces[1, closed] / lengths[closed])
