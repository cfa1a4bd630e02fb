"""The richer displacement by which errors are bounded from below, beside the best one there is."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from bounds import circle_of
from scenes import paper_scene
from scipy.sparse.linalg import spsolve

import vemcvx as vx
from vemcvx.bound.equilibrium import _assembled
from vemcvx.bound.skeleton import instant

pytestmark = pytest.mark.arithmetic


def added_up(places, matrices, size):
    """Sums (size, size) of matrices (c, m, m) at places (c, m)."""
    rows = [np.repeat(place, place.shape[1], axis=1).ravel() for place in places]
    columns = [np.tile(place, place.shape[1]).ravel() for place in places]
    values = np.concatenate([one.ravel() for one in matrices])
    return sp.csr_matrix((values, (np.concatenate(rows), np.concatenate(columns))), shape=(size, size))


def found(poisson=0.3, family="voronoi", n=6):
    effects = paper_scene().effects[1:]
    scene = vx.Scene(vx.Elasticity(young=200.0, poisson=poisson), *effects)
    history = vx.simulate(scene, vx.meshes.FAMILIES[family](n), [0.0, 1.0])
    circle = circle_of(history)
    return circle, circle.pair(instant(history, 1), instant(history, 0))


def energies(circle):
    stiffness = [one.fans.of_cells(one.stiffness) for one in circle.displacements]
    return added_up(circle.outlines, stiffness, circle.inside.size)


@pytest.mark.parametrize(("poisson", "family"), [(0.3, "voronoi"), (0.3, "squares"), (0.4999995, "voronoi")])
@pytest.mark.filterwarnings("ignore:Elasticity")
def test_what_is_found_is_nearly_the_best(poisson, family):
    """The best w takes off |w|^2 = R w; of any other one R w / |w| is the bound, and no larger."""
    circle, pair = found(poisson, family)
    S, F = energies(circle), circle.inside.free
    values, vectors = np.linalg.eigh(F.toarray())
    free = sp.csr_matrix(vectors[:, values > 0.5])
    residual = F @ np.random.default_rng(0).normal(size=F.shape[0])
    for left, least in ((F @ (S @ pair.w), 0.99), (residual, 0.9)):
        best = free @ spsolve(sp.csc_matrix(free.T @ S @ free), free.T @ left)
        w, bound = circle.inside.best(left, pair.defect.motion)
        assert np.allclose(F @ w, w, rtol=0, atol=1e-14 * np.abs(w).max())
        assert np.isclose(bound, np.sqrt(w @ (S @ w)), rtol=1e-9)
        assert np.isclose(left @ w, bound**2, rtol=1e-9)
        assert least * np.sqrt(left @ best) <= bound <= np.sqrt(left @ best) * (1.0 + 1e-9)


def test_stars_are_solved_exactly():
    """In its star S times the solution is the force, where nothing is held."""
    circle, _ = found()
    S, F = energies(circle), circle.inside.free
    S = (F @ S @ F).toarray()
    force = F @ np.random.default_rng(0).normal(size=F.shape[0])
    seen = []
    for places, inverses in circle.inside.stars:
        for at, inverse in zip(places, inverses, strict=True):
            z = F[at][:, at] @ inverse @ force[at]
            assert np.allclose(S[np.ix_(at, at)] @ z, force[at], atol=1e-9 * np.abs(force).max())
            seen.extend(at)
    # Every middle is in the stars of both ends of its edge.
    counts, vertices = np.bincount(seen), circle.posed.space.n_unknowns
    assert (counts[:vertices] == 1).all()
    assert (counts[vertices:] == 2).all()


@pytest.mark.long
def test_motions_of_edges_become_displacements_with_their_means():
    """Those that are linear and go on at vertices are displacements; all others keep their means on inner edges."""
    circle, _ = found()
    edges, inside, vertices = circle.equilibrium.edges, circle.inside, circle.posed.space.n_unknowns
    u = (inside.free @ np.random.default_rng(0).normal(size=inside.size))[:vertices].reshape(-1, 2)
    assert np.allclose(inside._near(edges.motions(edges.outline(u))), inside.free @ edges.outline(u), atol=1e-14)
    motion = np.random.default_rng(1).normal(size=4 * edges.count)
    ends, middles = np.split(inside._near(motion).reshape(-1, 2), [vertices // 2])
    means = ends[edges.nodes].mean(axis=1) / 3.0 + middles / 1.5
    inner = np.ones(edges.count, dtype=bool)
    inner[edges.outer[:, 0, 0] // 4] = False
    assert np.allclose(means[inner], motion.reshape(-1, 2, 2).mean(axis=1)[inner], atol=1e-14)


def test_what_balances_forces_on_edges_is_symmetric():
    """As preconditioners are."""
    inside = found()[0].inside
    r, s = (inside.free @ np.random.default_rng(seed).normal(size=inside.size) for seed in (1, 2))
    assert np.isclose(r @ inside._of_edges(s), s @ inside._of_edges(r), rtol=1e-9)
    assert r @ inside._of_edges(r) > 0.0


@pytest.mark.long
def test_residuals_that_do_no_work_have_no_displacement():
    circle, _ = found()
    w, bound = circle.inside.best(np.zeros(circle.inside.size), np.zeros(4 * circle.equilibrium.edges.count))
    assert bound == 0.0
    assert not w.any()


@pytest.mark.parametrize("family", ["squares", "voronoi", "hanging"])
def test_the_hybrid_problem_is_the_sum_of_its_cells(family):
    circle, _ = found(family=family)
    one = circle.equilibrium
    stiffness = [each.fans.of_cells(each.stiffness) for each in one.stresses]
    G = added_up([*one.edges.places, one.edges.outer.reshape(-1, 4)], [*stiffness, one.springs], one.P.shape[0])
    K = _assembled(one.edges, one.stresses, one.springs, one.P)
    assert abs(K - one.P.T @ G @ one.P).max() <= 1e-12 * abs(K).max()
