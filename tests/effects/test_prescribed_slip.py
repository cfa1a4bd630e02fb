"""Prescribed slip of blocks and of a fault, in closed form."""

import numpy as np
import pytest

import vemcvx as vx

E, NU = 1000.0, 0.3
STEEL = vx.Elasticity(E, NU)


def stacked(names=("low", "up"), dim=2, n=3):
    """Return two stacked blocks, in the order of `names`."""
    made, place = (vx.meshes.squares, vx.meshes.cubes)[dim - 2], {"low": (-1, 0), "up": (0, 1)}
    return vx.meshes.bodies({name: made(n, box=(*((0, 1),) * (dim - 1), place[name])) for name in names})


def settled(mesh, *effects):
    return vx.simulate(vx.Scene(STEEL, *effects), mesh, [0.0, 1.0], initial="settled")


@pytest.mark.parametrize("names", [("low", "up"), ("up", "low")])
def test_a_block_that_is_cut_through_slides_without_stress(names):
    """Positive slip moves the upper block to the right. Two free blocks move in opposite directions."""
    mesh, on = stacked(names), "|".join(names)
    for held, ways in (([vx.Clamp(on="low.bottom")], (0.0, 0.1)), ([], (-0.05, 0.05))):
        history = settled(mesh, vx.PrescribedSlip(0.1, on=on), *held)
        assert np.abs(history.stress(-1)).max() < 1e-11 * E
        for name, way in zip(("low", "up"), ways, strict=True):
            assert history.mean("displacement", on=name)[-1] == pytest.approx([way, 0.0], abs=1e-13)
        sign = 1.0 if names[0] == "up" else -1.0
        assert history.contact.slip[-1] == pytest.approx(np.tile([0.1 * sign, 0.0], (4, 1)), abs=1e-13)
    assert vx.error_bound(history, 1).upper < 1e-10


def test_in_space_slip_is_a_vector_along_the_surface():
    history = settled(stacked(dim=3, n=1), vx.Clamp(on="low.bottom"), vx.PrescribedSlip((0.1, -0.2, 9.0), on="low|up"))
    assert np.abs(history.stress(-1)).max() < 1e-11 * E
    assert history.mean("displacement", on="up")[-1] == pytest.approx([-0.1, 0.2, 0.0], abs=1e-13)


def test_friction_resists_a_prescribed_slip():
    """The slip .1 against the friction bound .5 on an edge of length 1 dissipates .05."""
    rub = vx.TrescaFriction(0.5, on="low|up")
    slip = vx.PrescribedSlip(lambda x, t: 0.1 * t + 0 * x[:, 0], on="low|up")
    history = vx.simulate(vx.Scene(STEEL, vx.Clamp(on="low.bottom"), slip, rub), stacked(), [0.0, 0.5, 1.0])
    assert history.dissipated[-1] == pytest.approx(0.05, abs=1e-14)
    assert history.reaction("low|up")[-1] == pytest.approx([-0.5, 0.0], abs=1e-12)
    assert history.force("low|up")[-1] == pytest.approx([0.5, 0.0], abs=1e-12)
    with pytest.raises(vx.SceneError, match=r"^CoulombFriction on low\|up: no pressure is known"):
        settled(stacked(), vx.Clamp(on="low.bottom"), slip, vx.CoulombFriction(0.5, on="low|up"))


def fault(size, levels):
    """Return a mesh of |x|, |y| < size, finer towards the crack |x| < 1, y = 0."""
    mesh = vx.meshes.squares(2 * size, box=((-size, size), (-size, size)))
    for k in range(levels):
        mesh = mesh.refine(np.abs(mesh.centroids).max(axis=1) < max(size / 2 ** (k + 1), 1.6))
    x, y = mesh.centroids.T
    return mesh.cut("fault", {"above": (np.abs(x) < 1) & (y > 0), "below": (np.abs(x) < 1) & (y < 0)})


def test_a_fault_with_the_slip_of_a_crack_has_its_stress_drop():
    """The slip (4 (1 - nu^2) tau / E) sqrt(1 - x^2) on |x| < 1 releases the shear stress tau."""
    tau, most = 2.0, 4 * (1 - NU**2) / E
    slip = vx.PrescribedSlip(lambda x, t: most * tau * t * np.sqrt(np.maximum(1 - x[:, 0] ** 2, 0.0)), on="fault")
    history = vx.simulate(vx.Scene(STEEL, slip), fault(10, 4), [0.0, 1.0])
    contact = history.contact
    traction = history.forces[-1][contact.nodes] / contact.lengths[:, None]
    away = np.abs(contact.points[:, 0]) < 0.7
    assert away.sum() > 20
    assert traction[away, 0] == pytest.approx(tau, rel=0.01)
    assert np.abs(contact.pressure).max() < 1e-12
    assert np.abs(contact.slip[-1]).max() == pytest.approx(most * tau, rel=1e-12)
