"""Every kind of scene against programs that were written again from scratch: scikit-fem, cvxpy, Clarabel.

On triangles virtual elements are linear elements, so that both answer one discrete problem. They agree to 1e-8 in
displacement, traction, pressure, reactions, energy, work and loss, over steps with reversals; see
:mod:`independent_p1`.
"""

from __future__ import annotations

import numpy as np
import pytest
from independent_p1 import Body, March

import vemcvx as vx

AGREE = 1e-8
SHARP = vx.Newton(accuracy=1e-10)


def vector(force):
    """f(x, y, t) as the package takes it."""
    return lambda x, t: np.column_stack([f + 0 * x[:, 0] for f in force(x[:, 0], x[:, 1], t)])


def scalar(value):
    return lambda x, t: value(x[:, 0], x[:, 1], t) + 0 * x[:, 0]


def pull(size, tilt=0.5, lift=-0.1):
    """A traction that reverses twice in the unit of time."""
    return lambda x, y, t: (size * np.sin(7 * t) * (1 + tilt * (y - 0.5)), lift * size * t + 0 * x)


def press(size):
    return lambda x, y, t: size * min(3 * t, 1.0) * (1 + 0.3 * x)


BLOCK, E, NU = vx.Elasticity(200.0, 0.3), 200.0, 0.3


def body(mesh):
    return Body(np.array(mesh.points), np.array(mesh.cells))


def block(mesh):
    return body(mesh).isotropic(E, NU)


def tresca(mesh):
    f, g = pull(8), lambda x, y, t: 3 + x - t
    scene = vx.Scene(
        BLOCK,
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    return scene, block(mesh).traction("left", f).clamp("right").bilateral("bottom").rub("bottom", g)


def tresca_integrated(mesh):
    f, g = pull(8), lambda x, y, t: 1 + x**2 + x * t
    scene = vx.Scene(
        BLOCK,
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(scalar(g), on="bottom", quadrature="integral"),
    )
    other = block(mesh).traction("left", f).clamp("right").bilateral("bottom")
    return scene, other.rub("bottom", g, integrated=True)


def signorini(mesh):
    """One-sided contact over a hollow, without friction."""
    f, q, gap = pull(8), press(2), lambda x, y, t: 0.002 * (1 - x) * x
    scene = vx.Scene(
        BLOCK,
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.Pressure(scalar(q), on="top"),
        vx.UnilateralContact(on="bottom", gap=scalar(gap)),
    )
    return scene, block(mesh).traction("left", f).pressure("top", q).clamp("right").wall("bottom", gap)


def moving_gap(mesh):
    """An obstacle that comes and goes, with Tresca's friction beside it."""
    f, q = pull(4), press(1)
    gap = lambda x, y, t: 0.003 * (1 + np.cos(9 * t)) * (1 + x)  # noqa: E731
    g = lambda x, y, t: 0.5  # noqa: E731
    scene = vx.Scene(
        BLOCK,
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.Pressure(scalar(q), on="top"),
        vx.UnilateralContact(on="bottom", gap=scalar(gap)),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    other = block(mesh).traction("left", f).pressure("top", q).clamp("right")
    return scene, other.wall("bottom", gap).rub("bottom", g)


def coulomb(mesh):
    f, q, mu = pull(3, lift=0), press(4), lambda x, y: 0.3 + 0.1 * x
    scene = vx.Scene(
        BLOCK,
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.Pressure(scalar(q), on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(lambda x, t: mu(x[:, 0], x[:, 1]), on="bottom"),
    )
    other = block(mesh).traction("left", f).pressure("top", q).clamp("right")
    return scene, other.wall("bottom").rub("bottom", coefficient=mu)


def viscous(mesh):
    f, g = pull(8), lambda x, y, t: 2.0
    scene = vx.Scene(
        BLOCK,
        vx.Viscosity(30.0, 10.0),
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    other = block(mesh).viscous(30.0, 10.0).traction("left", f).clamp("right")
    return scene, other.bilateral("bottom").rub("bottom", g)


def viscous_and_moved(mesh):
    """Dashpots between supports that move and a wall."""
    move = lambda x, y, t: (0.01 * np.sin(5 * t) * (1 + y), -0.004 * t + 0 * x)  # noqa: E731
    g = lambda x, y, t: 0.4  # noqa: E731
    scene = vx.Scene(
        BLOCK,
        vx.Viscosity(30.0, 10.0),
        vx.PrescribedDisplacement(vector(move), on="top"),
        vx.UnilateralContact(on="bottom", gap=0.001),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    other = block(mesh).viscous(30.0, 10.0).move("top", move)
    return scene, other.wall("bottom", lambda x, y, t: 0.001).rub("bottom", g)


def heated(mesh):
    f, g, theta = pull(4), lambda x, y, t: 9.0, lambda x, y, t: 40 * np.sin(5 * t) * (1 + x * 0.5 - y)
    scene = vx.Scene(
        BLOCK,
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.ThermalStrain(1e-3, scalar(theta)),
        vx.UnilateralContact(on="bottom", gap=0.001),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    other = block(mesh).traction("left", f).heat(1e-3, theta).clamp("right")
    return scene, other.wall("bottom", lambda x, y, t: 0.001).rub("bottom", g)


def orthotropic(mesh):
    f, g = pull(8), lambda x, y, t: 2.0
    scene = vx.Scene(
        vx.Orthotropic((300.0, 60.0), 0.25, 40.0, 0.6),
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    other = body(mesh).orthotropic(300.0, 60.0, 0.25, 40.0, 0.6).traction("left", f).clamp("right")
    return scene, other.bilateral("bottom").rub("bottom", g)


def compliant(mesh):
    """A soft floor with Coulomb's friction."""
    f, q = pull(3, lift=0), press(4)
    gap = lambda x, y, t: 0.001 * x  # noqa: E731
    scene = vx.Scene(
        vx.Elasticity(E, NU, plane="stress"),
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.Pressure(scalar(q), on="top"),
        vx.NormalCompliance(500.0, on="bottom", gap=scalar(gap)),
        vx.CoulombFriction(0.35, on="bottom"),
    )
    other = body(mesh).isotropic(E, NU, "stress").traction("left", f).pressure("top", q).clamp("right")
    return scene, other.wall("bottom", gap, 500.0).rub("bottom", coefficient=lambda x, y: 0.35)


def founded(mesh):
    """Springs in place of a clamp, and a body force."""
    f, g, b = pull(4), lambda x, y, t: 2.5, lambda x, y, t: (np.sin(6 * t) * (3 + x), -2 * t * y)
    scene = vx.Scene(
        BLOCK,
        vx.ElasticFoundation(150.0, 60.0, on="right"),
        vx.Traction(vector(f), on="left"),
        vx.BodyForce(vector(b)),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    other = block(mesh).springs("right", 150.0, 60.0).traction("left", f).body_force(b)
    return scene, other.bilateral("bottom").rub("bottom", g)


def moved(mesh):
    move = lambda x, y, t: (0.03 * np.sin(7 * t) * (1 + 0.2 * x), -0.01 * t * x)  # noqa: E731
    g = lambda x, y, t: 2.0  # noqa: E731
    scene = vx.Scene(
        BLOCK,
        vx.PrescribedDisplacement(vector(move), on="top"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    return scene, block(mesh).move("top", move).bilateral("bottom").rub("bottom", g)


def guided(mesh):
    """The top pressed down by its normal and dragged by its tangent, on a one-sided floor with Coulomb's friction."""
    down, along = lambda x, y, t: -0.02 * min(2 * t, 1), lambda x, y, t: 0.02 * np.sin(6 * t)
    scene = vx.Scene(
        BLOCK,
        vx.PrescribedDisplacement(scalar(down), on="top", direction="normal"),
        # The tangent at the top runs to the left.
        vx.PrescribedDisplacement(lambda x, t: -scalar(along)(x, t), on="top", direction="tangent"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
    )
    other = block(mesh).guide("top", (0, 1), down).guide("top", (1, 0), along)
    return scene, other.wall("bottom").rub("bottom", coefficient=lambda x, y: 0.3)


def unclamped(mesh):
    """Nothing but Tresca's friction holds the block against sliding."""
    f, q, g = pull(2, lift=0), press(2), lambda x, y, t: 4.0 - x
    scene = vx.Scene(
        BLOCK,
        vx.Traction(vector(f), on="left"),
        vx.Pressure(scalar(q), on="top"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    other = block(mesh).traction("left", f).pressure("top", q).bilateral("bottom")
    return scene, other.rub("bottom", g)


def two_materials(mesh):
    """A hard core that meets the floor."""
    f, q, g = pull(4), press(3), lambda x, y, t: 1.0
    hard = np.abs(np.array(mesh.centroids)[:, 0] - 0.5) < 0.25
    scene = vx.Scene(
        vx.Elasticity(2000.0, 0.2, on="hard"),
        vx.Elasticity(E, 0.35, on="soft"),
        vx.Clamp(on="right"),
        vx.Traction(vector(f), on="left"),
        vx.Pressure(scalar(q), on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(scalar(g), on="bottom"),
    )
    other = body(mesh).isotropic(np.where(hard, 2000.0, E), np.where(hard, 0.2, 0.35))
    other.traction("left", f).pressure("top", q).clamp("right").wall("bottom").rub("bottom", g)
    return scene, other


def unclamped_coulomb(mesh):
    """Nothing but its weight and Coulomb's friction holds the block."""
    f, q = lambda x, y, t: (min(3 * t, 1) * np.sin(7 * t) * (0.75 + 0.5 * y), 0 * x), press(2)
    scene = vx.Scene(
        BLOCK,
        vx.Traction(vector(f), on="left"),
        vx.Pressure(scalar(q), on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.5, on="bottom"),
    )
    other = block(mesh).traction("left", f).pressure("top", q)
    return scene, other.wall("bottom").rub("bottom", coefficient=lambda x, y: 0.5)


def pinned(mesh):
    """A force on a node, a stress without strain, a roller."""
    node = int(np.argmin(np.abs(np.array(mesh.points) - [0.0, 1.0]).sum(axis=1)))
    force, g = lambda t: np.array([2 * np.sin(6 * t), -t]), lambda x, y, t: 0.5 + y
    stress = lambda x, y, t: (4 * t * (1 + x), -3 * t + 0 * x, 2 * np.sin(5 * t) * y)  # noqa: E731
    scene = vx.Scene(
        BLOCK,
        vx.Symmetry(on="right"),
        vx.PointLoad(lambda x, t: force(t)[None, :], at=np.array(mesh.points)[node]),
        vx.Prestress(vector(stress)),
        vx.NormalCompliance(300.0, on="bottom"),
        vx.TrescaFriction(scalar(g), on="bottom"),
        vx.ElasticFoundation(20.0, 20.0, on="top"),
    )
    other = block(mesh).point_force(node, force).prestress(stress).springs("top", 20.0, 20.0)
    return scene, other.guide("right", (1, 0), lambda x, y, t: 0.0).wall("bottom", None, 300.0).rub("bottom", g)


QUICK = (
    *(tresca, tresca_integrated, signorini, moving_gap, coulomb, viscous, viscous_and_moved, heated, orthotropic),
    *(founded, moved, unclamped, unclamped_coulomb, two_materials, pinned),
)
SCENES = (*QUICK, compliant, guided)
TIMES = np.array([0.0, 0.1, 0.25, 0.4, 0.6, 0.65, 0.9])


def marked(mesh):
    hard = np.abs(mesh.centroids[:, 0] - 0.5) < 0.25
    return mesh.with_cell_data("hard", hard.astype(float)).with_cell_data("soft", (~hard).astype(float))


def nodal(rows_of, values, n, per_length=True):
    """(S, n, 2) sums at nodes of values along the directions of rows, each over its length or not."""
    out, column = np.zeros((len(values), n, 2)), 0
    for rows, *_ in rows_of:
        part = values[:, column : column + len(rows.nodes)] / (rows.lengths if per_length else 1.0)
        np.add.at(out, (slice(None), rows.nodes), part[:, :, None] * rows.directions)
        column += len(rows.nodes)
    return out


def differences(scene, other, mesh, times, solver=SHARP):
    """Largest difference of each quantity in parts of its largest value, and the independent result."""
    mine, theirs = vx.simulate(scene, mesh, times, solver=solver), March(other).run(times)
    contact, floor = mine.contact, other.rows("bottom")
    at = np.searchsorted(floor.nodes, contact.nodes)
    # What presses on the floor is all that acts across it but friction, which acts along.
    across = theirs.forces + nodal(other.rubs, theirs.lam, other.n, per_length=False)
    pairs = {
        "displacement": (mine.displacement, theirs.displacement),
        "traction": (contact.traction, -nodal(other.rubs, theirs.lam, other.n)[:, contact.nodes]),
        "pressure": (contact.pressure, across[:, contact.nodes, 1] / floor.lengths[at]),
        "energy": (mine.energy, theirs.energy),
        "work": (mine.work, theirs.work),
        "dissipated": (mine.dissipated, theirs.dissipated),
    }
    found = {name: off(one, two, np.abs(two).max(initial=0.0)) for name, (one, two) in pairs.items()}
    most = np.abs(theirs.forces).sum(axis=1).max()
    for side in ("left", "right", "bottom", "top"):
        nodes = other.nodes(side)
        found[f"forces {side}"] = off(mine.forces[:, nodes].sum(axis=1), theirs.forces[:, nodes].sum(axis=1), most)
    return found, theirs


def off(one, two, size):
    return np.abs(one - two).max(initial=0.0) / (size if size > 0 else 1.0)


def agree(case, n, times):
    mesh = marked(vx.meshes.triangles(n))
    scene, other = case(mesh)
    found, theirs = differences(scene, other, mesh, times)
    assert {name: error for name, error in found.items() if not error <= AGREE} == {}
    # What never changes would show little.
    assert not other.rubs or len({tuple(row) for row in theirs.slipping}) > 1
    assert not other.capped_weights or theirs.touching.any()


@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.__name__)
def test_scenes_agree_with_programs_written_again(case):
    agree(case, 4, TIMES)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@pytest.mark.parametrize("case", SCENES, ids=lambda case: case.__name__)
def test_scenes_agree_on_a_finer_mesh_in_more_steps(case):
    agree(case, 9, np.linspace(0, 1.2, 13))
