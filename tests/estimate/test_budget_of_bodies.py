"""The error budget of several bodies in contact."""

import numpy as np
import pytest

import vemcvx as vx

JOINT = "lower|upper"
STEEL = vx.Elasticity(10.0, 0.3)

pytestmark = pytest.mark.arithmetic


def two_blocks(below, above, n):
    lower = vx.meshes.FAMILIES[below](n[0])
    upper = vx.meshes.FAMILIES[above](n[1], box=((0, 1), (1, 2)))
    return vx.meshes.bodies({"lower": lower, "upper": upper})


def estimate_mesh_error(scene, mesh):
    return vx.error_budget(vx.simulate(scene, mesh, [0.0, 0.5, 1.0])).space


OUTSIDE = [f"lower.{side}" for side in ("bottom", "left", "right")]
OUTSIDE += [f"upper.{side}" for side in ("top", "left", "right")]


def shear(bound):
    """Return a scene of two blocks in uniform shear, whose joint sticks or slips as a whole."""
    return vx.Scene(
        STEEL,
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(lambda x, t: np.tile([t, 0.0], (len(x), 1)), on="upper.top"),
        vx.PrescribedDisplacement(
            0.0, on=[side for side in OUTSIDE if side[6:] in ("left", "right")], direction=(0, 1)
        ),
        vx.BilateralContact(on=JOINT),
        vx.TrescaFriction(bound, on=JOINT),
    )


def strained(contact):
    """Return a scene of two blocks in uniform strain, with supports at the ends of the joint."""
    gradient = np.array([[0.02, 0.04], [0.01, -0.12]])
    moved = vx.PrescribedDisplacement(lambda x, t: t * x @ gradient.T, on=OUTSIDE)
    return vx.Scene(STEEL, moved, contact(on=JOINT), vx.TrescaFriction(10.0, on=JOINT))


@pytest.mark.long
@pytest.mark.parametrize(
    "scene", [shear(10.0), shear(1.0), strained(vx.BilateralContact), strained(vx.UnilateralContact)]
)
def test_uniform_strain_leaves_no_residual(scene):
    assert estimate_mesh_error(scene, two_blocks("voronoi", "hexagons", (3, 4))).max() < 1e-12


@pytest.mark.long
def test_uniform_pressure_leaves_no_residual_where_three_bodies_meet():
    """A node of the lower body has partners on both upper bodies."""
    boxes = {"lower": ((0, 2), (0, 1)), "left": ((0, 1), (1, 2)), "right": ((1, 2), (1, 2))}
    mesh = vx.meshes.bodies({name: vx.meshes.squares(2, box=box) for name, box in boxes.items()})
    scene = vx.Scene(
        vx.Elasticity(10.0, 0.0),
        vx.PrescribedDisplacement(0.0, on="lower.bottom", direction=(0, 1)),
        vx.PrescribedDisplacement(0.0, on=["lower.left", "left.left", "right.right"], direction=(1, 0)),
        vx.Traction(lambda x, t: np.tile([0.0, -t], (len(x), 1)), on=["left.top", "right.top"]),
        vx.UnilateralContact(on=["lower|left", "lower|right"]),
    )
    assert estimate_mesh_error(scene, mesh).max() < 1e-12


@pytest.mark.long
def test_uniform_pressure_across_a_curve_leaves_a_residual_of_second_order():
    """The normal at a node is the mean of two chord normals, and has an error of second order."""
    found = []
    for sides in (16, 32):
        disc, ring = vx.meshes.ring([0.0, 0.5, 2.0], sides), vx.meshes.ring([2.0, 3.0], sides)
        scene = vx.Scene(
            vx.Elasticity(1.0, 0.3),
            vx.PrescribedDisplacement(lambda x, t: -0.01 * t * x, on="b.outer"),
            vx.UnilateralContact(on="a|b"),
            vx.TrescaFriction(1.0, on="a|b"),
        )
        found.append(estimate_mesh_error(scene, vx.meshes.bodies({"a": disc, "b": ring}))[-1])
    assert found[0] < (np.pi / 16) ** 2
    assert found[1] < 0.3 * found[0]


def pressed_and_pulled(young=(10.0, 30.0), friction=0.3):
    def head(x, t):
        return t * np.column_stack([np.full(len(x), 0.05), -0.05 - 0.05 * x[:, 0]])

    return vx.Scene(
        vx.Elasticity(young[0], 0.3, on="lower"),
        vx.Elasticity(young[1], 0.3, on="upper"),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(head, on="upper.top"),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("young", "families", "sizes", "fine"),
    [
        ((10.0, 30.0), ["squares"], [(4, 6)], 16),
        pytest.param((1.0, 1000.0), ["squares", "voronoi", "triangles"], [(4, 6), (8, 12)], 48, marks=pytest.mark.slow),
    ],
)
def test_estimates_on_two_blocks_are_one_to_five_times_the_error(young, families, sizes, fine):
    scene, times = pressed_and_pulled(young, 0.1), [0.0, 0.5, 1.0]
    truth = vx.simulate(scene, two_blocks("squares", "squares", (fine, fine)), times)
    for below in families:
        for n in sizes:
            history = vx.simulate(scene, two_blocks(below, "hexagons", n), times)
            assert history.contact.slip_count[-1] > 0
            true = vx.measures.energy_distance(history, truth).relative
            assert 1.0 <= vx.error_budget(history).largest["total"] / true <= 5.0


@pytest.mark.long
def test_bumps_of_a_gap_that_vanish_at_nodes_are_in_the_estimate():
    """The part "data" does not change if both bodies move up together."""

    def data_error(gap, lift):
        def ground(x, t):
            return np.tile([0.0, lift * t], (len(x), 1))

        scene = vx.Scene(
            STEEL,
            vx.PrescribedDisplacement(ground, on="lower.bottom"),
            vx.PrescribedDisplacement(lambda x, t: ground(x, t) - [0.0, 0.1 * t], on="upper.top"),
            vx.UnilateralContact(on=JOINT, gap=gap),
        )
        history = vx.simulate(scene, two_blocks("squares", "squares", (4, 4)), [0.0, 1.0])
        budget = vx.error_budget(history)
        return budget.parts["data"][-1] * budget.scale

    def bumpy(x, t):
        return -0.01 * t * np.sin(4 * np.pi * x[:, 0]) ** 2

    assert data_error(0.0, 0.0) == 0.0
    still = data_error(bumpy, 0.0)
    assert still > 0.0
    assert data_error(bumpy, 7.0) == pytest.approx(still, rel=1e-8)


@pytest.mark.long
def test_meshes_of_two_bodies_are_adapted():
    adapted = vx.adapt(pressed_and_pulled(), two_blocks("squares", "hexagons", (2, 3)), [0.0, 1.0], target=0.2)
    assert adapted.met
    assert len(adapted.passes) > 1
    assert adapted.history.mesh.interfaces[JOINT].bodies == ("lower", "upper")
