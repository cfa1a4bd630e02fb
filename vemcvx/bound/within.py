"""A path of bounds on cells within those of a run.

The bound of a history grows by what r = tau - sigma_0 - C eps(v) changes by (:mod:`.error_bound`): of a cycle in 20
steps on 8 x 8 squares that was nine tenths of it. It grows each time a load turns, while the error comes and goes with
the load; for X = tau - sigma is only known to be no longer than y, not where it points. What can be had is a smaller r.
The path of v and tau is free, so it may be that of the same run on other cells: those of the run, with some of them in
parts, and these again. Split are the cells that y grows by, which have most of

    sum over n of  |r_n - r_{n-1}|_K^2 / |r_n - r_{n-1}|,

not those in which r is large: the changes added up to .020 on 139 cells, and to .043 on 109 that were chosen by the
size of r. Then the path has more instants where friction lacks most of its law, for a node begins to slip in one step
once in every turn of the load, and lacks a half of what friction grows by times what it slips. In 20 steps on 8 x 8
squares bounds are 1.5 times the error at most for one cycle, 3.1 for three and 4.5 for five.

The displacement v_n of the run remains the one that errors are meant of. Let v have its nodal values on the finer
cells, and be linear between them on the edges of the run's cells, so that v_n - v vanishes on these. There sigma_0 is
constant, and tau balances f inside of cells. So with r_n = tau - sigma_0 - C eps(v_n), r the same of v,

    |r_n|^2  =  |r|^2 + |v_n|_a^2 - |v|_a^2 - 2 int f (v_n - v),

and nothing has to be integrated over cells that overlap; twice of what may be misread of both works of f is added. v_n
- v vanishes on contact, and X = tau - sigma is orthogonal to C eps of it: <r_n, X> = <r, X>, which is that of any
richer v + w, too.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints, largest, totals
from vemcvx.base.errors import MeshError, SceneError
from vemcvx.bound.hypercircle import IN_SPACE, Hypercircle, hypercircle
from vemcvx.bound.reading import reading
from vemcvx.bound.skeleton import Instant
from vemcvx.history import History
from vemcvx.meshes import PolygonMesh, plane_mesh, refinement
from vemcvx.scene import Scene
from vemcvx.scene.pose import pose_scene, unwarned
from vemcvx.stepping import march
from vemcvx.stepping.course import ACROSS

log = logging.getLogger("vemcvx")
PASSES, THETA, TIMES_AS_MANY, LOOKED = 8, 0.85, 2.0, 16
"""How often cells are split at most, those that have this part of what y grows by, as long as there are no more than
TIMES_AS_MANY times those of the run, and FEW; looked at at so many instants."""
FEW = 256
"""Without these, bounds of a sine in 8 steps on 8 x 8 squares were .045, not .039."""
HALVINGS, LONGER = 2, 3.0
"""How often steps of a path are halved at most, as long as there are no more than LONGER times those at first: of eight
waves, which lose .20, the bound is .35, and .21 where they are halved PASSES times, with 213 instants, not 155."""
ENOUGH = 0.3
"""Part of the largest |r| of the run's cells below which sums of |r_n - r_{n-1}| are left alone: at .5 bounds of a ramp
in 4 steps on 4 x 4 squares were 1.6 times the error, not 1.2."""


class Inner(NamedTuple):
    """A displacement v inside cells: |v|_a^2, the work of body forces on it, and a bound on the error of that work."""

    energy: float
    work: float
    misread: float

    @classmethod
    def of(cls, circle: Hypercircle, u: Floats, t: float) -> Inner:
        """The energy and works of the displacement with nodal values (n_nodes, 2) at an instant."""
        read = reading(circle.boundary, circle.fans, circle.densities_at(t), t)
        inside = replace(read, edges=np.zeros_like(read.edges), unseen=np.zeros_like(read.unseen))
        if inside.exact:
            return cls(*circle.inner(u, t), 0.0)
        v = circle.nodal(circle.equilibrium.edges.outline(u))
        return cls(*circle.inner(u, t), inside.work(v, u[circle.boundary.edges.outer_edges]))


class Sizes(NamedTuple):
    """Norms and defects of the displacement of a run, beside the stress of a path on cells within its own."""

    norm: float
    """|v_n|_a"""
    defect: float
    """|r_n|"""
    richer: float
    """|r| of v + w"""
    mesh: float
    data: float
    """parts of |r_n|"""
    cells: Floats
    """(n_cells,) squares of r in cells of the run"""


@dataclass(frozen=True, eq=False)
class Within:
    """Cells of a run, or cells within these."""

    scene: Scene
    mesh: PolygonMesh
    times: Sequence[float]
    """at which data are read"""
    carried: sp.csr_array
    """(nodes, n_nodes) nodal values from those of the run"""
    parents: Ints
    """the cell of the run in which each cell is"""

    @cached_property
    def circle(self) -> Hypercircle:
        """The parts of the scene that pairs on these cells are made of."""
        with unwarned():
            return hypercircle(pose_scene(self.scene, self.mesh, self.times))

    def growth(self, path: Sequence[Instant]) -> tuple[Floats, float, float]:
        """The growth of y along a path, but for friction.

        It is given as shares of cells (n_cells,), up to a factor, the sum of |r_n - r_{n-1}|, and the largest |r| of v.
        """
        circle, largest = self.circle, 0.0
        cells, added = np.zeros(self.mesh.n_cells), 0.0
        pair = circle.pair(path[0], path[0])
        for before, now in pairwise(path):
            beyond = circle.pair(now, before)
            squares = circle.squares_of_change(pair, beyond)
            step = float(np.sqrt(squares.sum()))
            cells += squares / (step or 1.0)
            added, largest = added + step, max(largest, beyond.A2)
            pair = beyond
        return cells, added, float(np.sqrt(largest))

    def split(self, squares: Floats) -> Within:
        """With those cells in parts that have most of such squares (n_cells,)."""
        finer = refinement(self.mesh, largest(squares, THETA))
        carried, parents = finer.prolongation @ self.carried, self.parents[finer.parents]
        return Within(self.scene, finer.mesh, self.times, carried, parents)

    def lacking(self, path: Sequence[Instant]) -> Floats:
        """(k,) D_n of the steps of a path."""
        surfaces = [self.circle.surface(now, before) for before, now in pairwise([path[0], *path])]
        return np.array([self.circle.boundary.lacking(one, other) for one, other in pairwise(surfaces)])

    def path(self, history: History, instants: Floats) -> list[Instant]:
        """The run once more, at these instants; not certified, for any path that is admissible will do."""
        posed, start = self.circle.posed, self.carried @ history.displacement[0]
        P, motion = posed.supports.P, posed.supports.motion
        initial = P.T @ (start.ravel() - motion(float(instants[0])))
        run = march(posed.system, instants, initial=initial, check=False)
        if len(posed.terms) != run.multipliers.shape[1]:
            raise SceneError(
                "error_bound: friction acts, or supports move, between the instants of this run only; simulate the "
                "scene at more instants."
            )
        parts = run.state, run.multipliers, run.pressures, run.weights, run.worn
        return [
            Instant(float(t), (P @ y + motion(float(t))).reshape(-1, 2), *others)
            for t, y, *others in zip(instants, *parts, strict=True)
        ]

    def sizes(self, now: Instant, u: Floats, of_run: Inner) -> Sizes:
        """The Sizes of the displacement with nodal values (n_nodes, 2) of the run at an instant of the path."""
        circle, carried = self.circle, self.carried @ u
        pair, own = circle.pair(replace(now, u=carried), now), Inner.of(circle, carried, now.t)
        squares = circle.squares_of(pair.richer, circle.body_forces.of(pair.densities))
        apart = of_run.energy - own.energy - 2.0 * (of_run.work - own.work - of_run.misread - own.misread)
        return Sizes(
            norm=float(np.sqrt(of_run.energy)),
            defect=float(np.sqrt(max(pair.A2 + apart, 0.0))),
            richer=float(np.sqrt(circle.enlarged(squares, pair.richer, pair.oscillation).sum())),
            mesh=float(np.sqrt(max(pair.squares.sum() + apart, 0.0))),
            data=float(np.sqrt(np.sum(pair.oscillation**2))),
            cells=totals(self.parents, pair.cells, int(self.parents.max()) + 1),
        )


def within_cells(
    scene: Scene, history: History, instants: Floats, times: Sequence[float]
) -> tuple[Within, list[Inner], list[Instant]]:
    """Cells within those of a run, its displacements in its own cells, and a path that has these instants.

    Data are read at `times`.
    """
    mesh, at = plane_mesh(history.mesh, "error_bound", IN_SPACE), history.trajectory.times.tolist()
    whole = Within(scene, mesh, times, sp.eye_array(mesh.n_nodes, format="csr"), np.arange(mesh.n_cells))
    # A copy of the cells: what is computed once on them is let go with it.
    own = replace(whole)
    inner = [Inner.of(own.circle, u, t) for u, t in zip(history.displacement, at, strict=True)]
    growth = own.growth(own.path(history, looked_at(instants)))
    try:
        within = _finer(own, history, instants, growth)
        return within, inner, _shorter(within, history, instants, growth[2])
    except (MeshError, SceneError) as error:
        # As where data are given cell by cell, or finer cells would move from where the run begins. What was found, and
        # not what to do: the advice is for a run, and this one is not the reader's.
        log.info("error_bound: the path is on the cells of the run: %s.", str(error).partition(". ")[0].rstrip("."))
    return whole, inner, _shorter(whole, history, instants, growth[2])


def looked_at(instants: Floats) -> Floats:
    """The ends of a path, and LOOKED instants of it at most: at random, so as not to be in step with its cycles."""
    inside = instants[1:-1]
    some = np.random.default_rng(0).permutation(len(inside))[: LOOKED - 1]
    return np.union1d(instants[[0, -1]], inside[some])


def _finer(within: Within, history: History, instants: Floats, growth: tuple[Floats, float, float]) -> Within:
    """The cells in parts, until what y grows by on them, `growth` at first, is ENOUGH of |r| at most."""
    (cells, added, r), most = growth, TIMES_AS_MANY * within.mesh.n_cells + FEW
    for _ in range(PASSES):
        if added <= ENOUGH * r or within.mesh.n_cells > most:
            break
        within = within.split(cells)
        cells, added, _ = within.growth(within.path(history, looked_at(instants)))
    return within


def _shorter(within: Within, history: History, instants: Floats, unit: float) -> list[Instant]:
    """A path with these instants, and those between where friction lacks most, until (2 D)^{1/2} is |r| at most."""
    path, most, least = within.path(history, instants), LONGER * len(instants), 4.0 * ACROSS * np.ptp(instants)
    for _ in range(HALVINGS):
        lacking = within.lacking(path)
        lacking[np.diff(instants) < least] = 0.0
        if np.sqrt(2.0 * lacking.sum()) <= unit or len(instants) > most:
            break
        halved = largest(lacking, THETA)
        instants = np.union1d(instants, 0.5 * (instants[halved] + instants[halved + 1]))
        path = within.path(history, instants)
    return path
