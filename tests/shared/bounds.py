"""Energy errors of displacements, computed from a known displacement or from a finer run.

|.|_a is the energy norm. A cell is a fan of n triangles. Arrays of c cells have the shape (c, n, ...). A displacement
has 20 values in a triangle, at 10 nodes. Strains of a triangle are evaluated at 18 points, the stations
(`vemcvx.bound.fan`). The conforming displacement is linear on edges, and has the least potential energy in cells.
"""

from __future__ import annotations

import numpy as np

import vemcvx as vx
from vemcvx.bound.displacement import NODES, SLOPES, _slots, triangle_forms
from vemcvx.bound.fan import COEFFICIENTS, RULE, RULE_WEIGHTS, monomial_slopes, monomials
from vemcvx.bound.hypercircle import Defect, hypercircle
from vemcvx.bound.skeleton import instant
from vemcvx.estimate.adapt import cells_to_refine
from vemcvx.results.probe import locate
from vemcvx.scene import pose_scene


def circle_of(history):
    return hypercircle(pose_scene(history.scene, history.mesh, history.trajectory.times.tolist()))


def inside(fans, outline, body):
    """Return the displacement (c, n, 20) of least potential energy with the boundary values `outline`."""
    n, around = fans.n, _slots(fans.n)
    within = 6 * n + 2 + 8 * np.arange(n)[:, None] + np.arange(8)
    T, F = triangle_forms(fans), np.einsum("ctij,cj->cti", fans.forces, body)
    K, f = np.zeros((len(outline), 14 * n + 2, 14 * n + 2)), np.zeros((len(outline), 14 * n + 2))
    for t, place in enumerate(np.concatenate([within, around], axis=1)):
        K[:, place[:, None], place] += T[:, t, :20, :20]
        f[:, place] -= np.einsum("cij,cj->ci", T[:, t, :20, 20:], F[:, t])
    known = 2 * n + 2 + np.arange(4 * n)
    free, v = np.setdiff1d(np.arange(14 * n + 2), known), np.zeros(f.shape)
    v[:, known] = outline
    right = f[:, free] - np.einsum("cij,cj->ci", K[:, free[:, None], known], outline)
    v[:, free] = np.linalg.solve(K[:, free[:, None], free], right[..., None])[..., 0]
    return np.concatenate([v[:, around], v[:, within]], axis=2)


def compute_nodal_values(circle, u, t):
    """Yield fans, and nodal values (c, n, 20) of the conforming displacement."""
    body = circle.boundary.reader.body_forces(t)[0]
    outline = circle.equilibrium.edges.outline(u)
    for one in circle.forms:
        yield one.fans, inside(one.fans, outline[one.outlines], body[one.fans.cells])


def energy_distance(circle, one, other):
    """Return |v - w|_a for the conforming displacements v, w of two nodal arrays."""
    apart = one - other
    body = np.zeros((circle.posed.space.mesh.n_cells, 6))
    v = Defect(np.zeros(0), circle.equilibrium.edges.outline(apart), body)
    energy = sum(circle._inner(form, v.outline, v.outline).sum() for form in circle.forms)
    return float(np.sqrt(energy))


def compute_enriched_values(pair):
    """Yield fans, and nodal values (c, n, 20) of the enriched displacement."""
    for one in pair.circle.forms:
        yield one.fans, inside(one.fans, pair.richer.outline[one.outlines], pair.read.body[one.fans.cells])


def strains_at_stations(fans, v):
    """Return the strains (c, n, 18, 3) at stations from nodal values v (c, n, 20)."""
    c, n, _ = v.shape
    grad = np.einsum("sak,ctkr,ctab->ctsrb", SLOPES, v.reshape(c, n, 10, 2), fans.back, optimize=True)
    return np.stack([grad[..., 0, 0], grad[..., 1, 1], grad[..., 0, 1] + grad[..., 1, 0]], axis=3)


def evaluate_at_rule(values):
    """Yield fans, strains (c, n, 21, 3), quadrature points and quadrature weights."""
    lagrange = np.stack([monomials(RULE[k]) @ COEFFICIENTS[k] for k in range(3)])
    for fans, v in values:
        c, n, _ = v.shape
        strain = strains_at_stations(fans, v).reshape(c, n, 3, 6, 3)
        weights = RULE_WEIGHTS * fans.doubled_areas[..., None]
        x = fans.centres[:, None, None] + np.einsum("qa,ctba->ctqb", RULE.reshape(-1, 2), fans.B)
        yield fans, np.einsum("pqi,ctpik->ctpqk", lagrange, strain).reshape(c, n, 21, 3), x, weights


def strain_at(circle, u, t, x):
    """Return strains (q, 3) of the conforming displacement at points (q, 2)."""
    found = locate(circle.posed.space.mesh, x)
    cells = np.full(len(x), -1)
    cells[found.points] = found.cells
    strain = np.zeros((len(x), 3))
    for fans, v in compute_nodal_values(circle, u, t):
        mine = np.flatnonzero(np.isin(cells, fans.cells))
        if len(mine) == 0:
            continue
        at = np.searchsorted(fans.cells, cells[mine])
        back = np.linalg.inv(fans.B)[at]
        hat = np.einsum("qtab,qb->qta", back, x[mine] - fans.centres[at])
        corners = np.concatenate([1.0 - hat.sum(axis=2, keepdims=True), hat], axis=2)
        t_of = corners.min(axis=2).argmax(axis=1)
        every = np.arange(len(mine))
        # A triangle has three parts. In part k, barycentric coordinate k + 2 (mod 3) is smallest.
        part = (corners[every, t_of].argmin(axis=1) + 1) % 3
        slopes = np.einsum("qai,qij->qaj", monomial_slopes(hat[every, t_of]), COEFFICIENTS[part])
        values = v[at, t_of].reshape(-1, 10, 2)[every[:, None], NODES[part]]
        grad = np.einsum("qaj,qjp,qar->qrp", slopes, values, back[every, t_of])
        strain[mine] = np.stack([grad[:, 0, 0], grad[:, 1, 1], grad[:, 0, 1] + grad[:, 1, 0]], axis=1)
    return strain


def error_from(circle, u, t, strain):
    """Return |w - v|_a. The strains of w are strain(x), and v is the conforming displacement of u."""
    return integrate_error(compute_nodal_values(circle, u, t), strain)


def integrate_error(values, strain):
    """Return |w - v|_a, where w has the strains strain(x), and v has the nodal values `values`."""
    squared = 0.0
    for fans, own, x, weights in evaluate_at_rule(values):
        apart = strain(x.reshape(-1, 2)).reshape(own.shape) - own
        squared += np.einsum("ctq,ctqk,ckl,ctql->", weights, apart, fans.C, apart, optimize=True)
    return float(np.sqrt(squared))


def enriched_bound(pair):
    """Return a bound of |u - v - w|_a for the solution u and the enriched displacement v + w."""
    A2 = pair.circle.squares(pair.richer).sum()
    return float(0.5 * np.sqrt(A2) + np.sqrt(0.25 * A2 + pair.law_defect))


def beside_refined(coarse, part, most=20_000):
    """Compare a coarse run of one step with a finer run.

    Let u be the exact solution, v and v_f the displacements of the coarse and the finer run, and w_f the enrichment of
    v_f. The results are |v - v_f - w_f|_a, a bound of |u - v_f - w_f|_a, and the ErrorBound of the finer run. The finer
    mesh is refined until the bound is at most `part` times the coarse error, or the mesh has more than `most` cells.
    """
    times, mesh = coarse.trajectory.times, coarse.mesh.refine().refine()
    target = part * vx.error_bound(coarse, step=-1).lower
    while True:
        fine = vx.simulate(coarse.scene, mesh, times)
        circle = circle_of(fine)
        pair, bound = circle.pair(instant(fine, 1), instant(fine, 0)), vx.error_bound(fine, step=-1)
        if enriched_bound(pair) <= target or mesh.n_cells > most:
            break
        mesh = mesh.refine(cells_to_refine(bound.cells, 0.0, 0.85))
    u, t, own = coarse.displacement[-1], times[-1], circle_of(coarse)
    error = integrate_error(compute_enriched_values(pair), lambda x: strain_at(own, u, t, x))
    return error, enriched_bound(pair), bound
