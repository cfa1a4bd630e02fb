"""Units: the same scene in metres and pascals, in millimetres and megapascals, and in extreme units."""

from __future__ import annotations

from functools import cache

import numpy as np

import vemcvx as vx
from hard.case import Case, Setting
from hard.ground import TIMES, cyclic, voronoi

N = 10
PLAIN = voronoi(N)


def scene(length=1.0, force=1.0):
    """Return the block of Feng, Han and Huang; `length` multiplies lengths, and `force` multiplies forces."""
    stress = force / length

    def pull(x, t):
        y = x[:, 1] / length
        return np.column_stack([8 * (1.25 - y) * cyclic(t), np.full(len(x), -0.01 * cyclic(t))]) * stress

    return vx.Scene(
        vx.Elasticity(young=200.0 * stress, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=4.0 * stress, on="bottom"),
    )


def resize(length):
    return vx.PolygonMesh(PLAIN.points * length, PLAIN.cells, boundaries=PLAIN.boundaries)


def setting(length, force):
    return Setting(scene(length, force), resize(length), TIMES)


SOLVERS = {"Newton": vx.Newton(1e-8), "CLARABEL": vx.Clarabel(1e-6), "OSQP": vx.OSQP(1e-6)}


@cache
def solve_plain(name):
    return vx.simulate(scene(), PLAIN, TIMES, solver=SOLVERS[name], check=False)


def plain(history):
    """Return a run of the unscaled scene by the solver of `history`."""
    return solve_plain(next(name for name in SOLVERS if name.lower() in history.solver.lower()))


def same_bits(length):
    def holds(setting, history):
        same = np.array_equal(history.displacement / length, plain(history).displacement)
        return "" if same else "not the same to the bit"

    return holds


def same_answer(length):
    def holds(setting, history):
        before = plain(history)
        apart = np.abs(history.displacement / length - before.displacement).max() / np.abs(before.displacement).max()
        if "Newton" in history.solver and apart > max(1e-9, 100 * before.certificate_floor.max()):
            return f"displacements differ by {apart:.1e}"
        # Units change the residuals of OSQP by a factor of up to two, so that its numbers of iterations differ.
        if "OSQP" not in history.solver and np.abs(history.iterations - before.iterations).max() > 1:
            return f"iterations {history.iterations} and {before.iterations}"
        if "Newton" in history.solver and (history.contact.sticking != before.contact.sticking).any():
            return "stick sets differ"
        return ""

    return holds


def powers(length, force):
    name = f"lengths 2^{round(np.log2(length))}, forces 2^{round(np.log2(force))}"
    return Case(name, lambda: setting(length, force), holds=same_bits(length))


def tens(length, force):
    return Case(f"lengths {length:.0e}, forces {force:.0e}", lambda: setting(length, force), holds=same_answer(length))


CASES = (
    Case("mm and MPa: lengths 1e3", lambda: setting(1e3, 1.0), holds=same_answer(1e3)),
    Case("SI: lengths 1e-3, forces 9.81", lambda: setting(1e-3, 9.81), holds=same_answer(1e-3)),
    *(powers(2.0**p, 2.0**q) for p, q in ((-40, 0), (40, 0), (0, -40), (0, 40), (13, -29))),
    *(tens(p, q) for p, q in ((1.0, 1e-12), (1.0, 1e12), (1e-6, 1e12), (1e6, 1e-12))),
)
