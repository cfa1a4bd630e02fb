"""Observed orders: O(h) for all families and lambda, and O(k) if the steps miss a reversal."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import FAMILIES, OF_TRIANGLES, mostly_slow

import manufactured_full_slip as slip
import missed_reversal as reversal
import vemcvx as vx

FIRST, SECOND = pytest.approx(1.0, abs=0.1), pytest.approx(2.0, abs=0.2)
energy_distance, orders = vx.measures.energy_distance, vx.measures.orders


def slip_errors(family, lam, sizes, times=(0.0, 1.0), solver=None, **options):
    """Return mesh sizes, relative energy errors and relative L2 errors."""
    rows = []
    for n in sizes:
        history = vx.simulate(
            slip.scene(lam / (2 * (lam + slip.MU)), **options), slip.mesh(n, family), times, solver=solver
        )
        energy = vx.measures.energy_error(history, lambda x, t: slip.strain(x[:, 0], x[:, 1], t, lam))
        l2 = vx.measures.l2_error(history, lambda x, t: slip.displacement(x[:, 0], x[:, 1], t, lam))
        rows.append((history.mesh.n_cells**-0.5, energy.relative, l2.relative))
    return np.array(rows).T


@mostly_slow("family, sizes", [("voronoi", (8, 16)), *((name, (8, 16, 32, 64)) for name in FAMILIES)])
@pytest.mark.long
def test_energy_errors_hardly_depend_on_lambda(family, sizes):
    """Linear triangles lock, and are left out for large lambda."""
    found = []
    for lam in (1.0,) if family in OF_TRIANGLES else (1.0, 1e2, 1e4, 1e6):
        # At lambda = 1e6, rounding in K causes relative energy errors of 1e-6 (docs/theory/incompressible.md).
        solver = vx.Newton(accuracy=1e-5) if lam == 1e6 else None
        h, energy, l2 = slip_errors(family, lam, sizes, solver=solver, pulled=True)
        assert orders(h, energy).slope == FIRST, lam
        assert orders(h, l2).slope == SECOND, lam
        found.append(energy)
    for energy in found:
        assert energy == pytest.approx(found[0], rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("family", ["squares", "voronoi"])
def test_errors_are_of_first_order_in_the_step_if_a_reversal_is_missed(family):
    """With an even number of steps, a step ends at the reversal and the run is exact."""
    mesh, steps = reversal.mesh(10, family), np.array([9, 27, 81])
    reference = vx.simulate(reversal.scene(), mesh, reversal.times(2 * 81))
    contact = reference.contact.sticking
    assert contact[40].any()
    assert not contact[40].all()
    assert not contact[-1].all()
    runs = [vx.simulate(reversal.scene(), mesh, reversal.times(n)) for n in (2, 18, *steps)]
    assert orders(1 / steps, [reversal.largest_distance(run, reference) for run in runs[2:]]).slope == FIRST
    at_end = [energy_distance(run, reference, kind="nodal").relative for run in runs]
    assert max(at_end[:2]) < 1e-8
    assert orders(1 / steps, at_end[2:]).slope == FIRST
