"""Friction: none, very small and very large bounds, and bounds that jump, vanish, vary or make no sense."""

from __future__ import annotations

import numpy as np

import vemcvx as vx
from hard.case import REFUSAL, WARNING, Case, Setting
from hard.ground import TIMES, block, cyclic, on, shear_block, voronoi

MESH = voronoi(12)


def sticks(setting, history):
    return "" if history.contact.sticking.all() else "something slips"


def slips(setting, history):
    still = history.contact.sticking[1:][np.abs(np.diff(np.sin(2 * np.pi * TIMES))) > 0]
    return "" if not still.any() else f"{still.sum()} nodes stick"


def with_bound(name, bound, **more):
    return Case(name, lambda: on(MESH, bound=bound), **more)


def jump(x, t):
    return np.where(x[:, 0] < 0.5, 1e-6, 1e2)


def fades(x, t):
    return 8.0 * x[:, 0]


def breathes(x, t):
    return np.full(len(x), 4.0 * (1.0 + 0.9 * np.cos(9 * t)))


def every_other():
    """Return a setting whose friction bound is zero at every other node of the floor."""
    mesh = vx.meshes.squares(12)
    return on(mesh, bound=lambda x, t: np.where(np.round(x[:, 0] * 12) % 2 == 0, 0.0, 8.0))


def at_the_threshold():
    """Return uniform shear in which friction just reaches the bound at every node, and no node slips."""
    mu, bound = 80.0, 4.0

    def top(x, t):
        return np.tile([t * bound / mu, 0.0], (len(x), 1))

    def side(sign):
        return lambda x, t: np.tile([0.0, sign * t * bound], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.25),
        vx.PrescribedDisplacement(top, on="top"),
        vx.Traction(side(1.0), on="right"),
        vx.Traction(side(-1.0), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom"),
    )
    mesh = vx.meshes.squares(8)
    times = np.linspace(0, 1, 5)
    exact = np.stack([np.column_stack([t * bound / mu * mesh.points[:, 1], 0 * mesh.points[:, 1]]) for t in times])
    return Setting(scene, mesh, times, exact)


def corner():
    """Return a body with friction on its bottom and its left side, which meet in a corner."""

    def press(x, t):
        return np.tile([-20.0 * cyclic(t), -30.0 * cyclic(t)], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(press, on="top"),
        vx.BilateralContact(on=["bottom", "left"]),
        vx.TrescaFriction(bound=2.0, on=["bottom", "left"]),
    )
    return Setting(scene, MESH, TIMES)


def between_clamps():
    """Return a body clamped left and right and sheared on top: its contact with the floor ends at the clamps."""

    def shear(x, t):
        return np.tile([20.0 * cyclic(t), -10.0 * cyclic(t)], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Clamp(on=["left", "right"]),
        vx.Traction(shear, on="top"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=1.0, on="bottom"),
    )
    return Setting(scene, MESH, TIMES)


def incline(degrees=30.0):
    """Return `block` on an incline. The energies are equal to the energies on level ground."""
    turn = np.radians(degrees)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    mesh = vx.PolygonMesh(MESH.points @ R.T, MESH.cells, boundaries=MESH.boundaries)

    def pull(x, t):
        y = x @ R
        return np.column_stack([8 * (1.25 - y[:, 1]) * cyclic(t), np.full(len(x), -0.01 * cyclic(t))]) @ R.T

    scene = vx.Scene(*(vx.Traction(pull, on="left") if isinstance(e, vx.Traction) else e for e in block()))
    return Setting(scene, mesh, TIMES)


def as_if_level(setting, history):
    level = vx.simulate(block(), MESH, TIMES)
    apart = np.abs(history.energy - level.energy).max() / level.energy.max()
    # Relative errors of energies are twice the relative errors in the energy norm; both runs have errors.
    allowed = 2 * (history.certificate_total[-1] + level.certificate_total[-1]) + 1e-12
    return "" if apart <= allowed else f"energies differ by {apart:.1e} from those of the unrotated block"


def overlapping():
    mesh = MESH.with_boundary("rough", lambda x: (x[:, 1] == 0) & (x[:, 0] < 0.7))
    scene = vx.Scene(
        *(e for e in block(bound=None)),
        vx.TrescaFriction(bound=4.0, on=["rough", "bottom", "rough"]),
    )
    return Setting(scene, mesh, TIMES)


def counts_once(setting, history):
    if "Newton" not in history.solver:
        return ""
    once = vx.simulate(block(), MESH, TIMES)
    return "" if np.array_equal(once.displacement, history.displacement) else "an edge named twice counts twice"


def no_contact_edges():
    mesh = MESH.with_boundary("nowhere", lambda x: x[:, 0] > 9)
    scene = vx.Scene(*block(contact=None, bound=None), vx.TrescaFriction(bound=4.0, on="nowhere"))
    return Setting(scene, mesh, TIMES)


CASES = (
    with_bound("g = 0", 0.0, holds=slips),
    with_bound("g = 1e-8", 1e-8, holds=slips),
    with_bound("g = 1e8", 1e8, holds=sticks),
    with_bound("g jumps by 1e8", jump),
    Case("g = 0 at every other node", every_other),
    with_bound("g vanishes at one end", fades),
    with_bound("g varies in time", breathes),
    with_bound("g < 0", -1.0, must=REFUSAL, says="must be >= 0"),
    with_bound("g = NaN", np.nan, must=REFUSAL, says="found NaN"),
    with_bound("g = infinity", np.inf, must=REFUSAL, says="infinity"),
    Case("friction exactly at its bound", at_the_threshold),
    Case(
        "all nodes slip, then all nodes stick",
        lambda: shear_block(vx.meshes.voronoi(6, box=((0, 2), (0, 0.5)))),
    ),
    Case("friction on no edge", no_contact_edges, REFUSAL, "selects none of the 48 boundary edges"),
    Case("contact that meets the clamp at both ends", between_clamps),
    Case("contact around a corner", corner),
    Case("contact on an incline", incline, holds=as_if_level),
    Case("overlapping boundary names", overlapping, holds=counts_once),
    Case("friction without contact", lambda: on(MESH, contact=None), WARNING, "nothing holds the body in the normal"),
)
