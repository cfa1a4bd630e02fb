"""A path of bounds on cells within those of a run.

The bound of a history grows by what r = tau - sigma_0 - C eps(v) changes by (:mod:`.error_bound`): of a cycle in 20
steps on 8 x 8 squares that was nine tenths of it. It grows each time a load turns, while the error comes and goes with
the load; for X = tau - sigma is only known to be no longer than y, not where it points. What can be had is a smaller r.
The path of v and tau is free, so it may be that of the same run on other cells: those of the run, with the ones in
parts in which r is largest, as at corners where something is held. Such cells are few, and r is half as large.

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

from vemcvx.arrays import Floats, Ints, totals
from vemcvx.bound.hypercircle import Hypercircle, hypercircle, outline_of
from vemcvx.bound.reading import reading
from vemcvx.bound.skeleton import Instant
from vemcvx.errors import MeshError, SceneError
from vemcvx.history import History
from vemcvx.meshes import PolygonMesh, plane_mesh
from vemcvx.meshes.local_refinement import refinement
from vemcvx.scene import Scene
from vemcvx.scene.pose import pose_scene, unwarned
from vemcvx.stepping.backward_euler import march

log = logging.getLogger("vemcvx")
PASSES, THETA, MOST, LOOKED = 2, 0.7, 0.125, 8
"""How often cells are split: those that have this part of the squares of r at so many instants, but no more than this
part of all. Bounds of a cycle on 8 x 8 squares were 7.9 times the error without, 3.8 with two passes, 2.9 with three,
and took 1.6 and 2.5 times as long on 64 x 64."""


class Inner(NamedTuple):
    """Of a displacement v in cells |v|_a^2, the work of body forces on it, and what may be misread of that."""

    energy: float
    work: float
    misread: float

    @classmethod
    def of(cls, circle: Hypercircle, u: Floats, t: float) -> Inner:
        """Those of the displacement with nodal values (n_nodes, 2) at an instant."""
        read = reading(circle.boundary, circle.fans, circle.densities_at(t), t)
        inside = replace(read, edges=np.zeros_like(read.edges), unseen=np.zeros_like(read.unseen))
        if inside.exact:
            return cls(*circle.inner(u, t), 0.0)
        v = [one.nodal(outline_of(one.fans, u)) for one in circle.displacements]
        return cls(*circle.inner(u, t), inside.work(v, u[circle.boundary.edges.outer_edges]))


class Sizes(NamedTuple):
    """Of the displacement of a run, beside the stress of a path on cells within its own."""

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
        """All that pairs on these cells are made of."""
        with unwarned():
            return hypercircle(pose_scene(self.scene, self.mesh, self.times))

    def split(self, path: Sequence[Instant]) -> Within:
        """With those cells in parts in which r along a path is largest."""
        squares = np.zeros(self.mesh.n_cells)
        for before, now in pairwise(path):
            pair = self.circle.pair(now, before)
            squares += pair.cells + totals(self.circle.boundary.edges.outer, 2.0 * pair.surface.gap, len(squares))
        worst = np.argsort(-squares, kind="stable")
        sums = np.cumsum(squares[worst])
        count = min(int(np.searchsorted(sums, THETA * sums[-1])), int(MOST * len(worst))) + 1
        finer = refinement(self.mesh, worst[:count])
        carried, parents = finer.prolongation @ self.carried, self.parents[finer.parents]
        return Within(self.scene, finer.mesh, self.times, carried, parents)

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
        apart = of_run.energy - own.energy - 2.0 * (of_run.work - own.work - of_run.misread - own.misread)
        return Sizes(
            norm=float(np.sqrt(of_run.energy)),
            defect=float(np.sqrt(max(pair.A2 + apart, 0.0))),
            richer=circle.norm(pair.richer, pair.oscillation),
            mesh=float(np.sqrt(max(pair.squares.sum() + apart, 0.0))),
            data=float(np.sqrt(np.sum(pair.oscillation**2))),
            cells=totals(self.parents, pair.cells, int(self.parents.max()) + 1),
        )


def within_cells(
    scene: Scene, history: History, instants: Floats, times: Sequence[float]
) -> tuple[Within, list[Inner], list[Instant]]:
    """Cells within those of a run, its displacements in its own cells, and a path; data are read at `times`."""
    mesh, at = plane_mesh(history.mesh, "error_bound"), history.trajectory.times.tolist()
    whole = Within(scene, mesh, times, sp.eye_array(mesh.n_nodes, format="csr"), np.arange(mesh.n_cells))
    # Of each mesh what is made once is let go with its cells.
    within = replace(whole)
    inner = [Inner.of(within.circle, u, t) for u, t in zip(history.displacement, at, strict=True)]
    some = instants[np.unique(np.linspace(0, len(instants) - 1, LOOKED + 1).astype(int))]
    try:
        for _ in range(PASSES if len(some) > 1 else 0):
            within = within.split(within.path(history, some))
        return within, inner, within.path(history, instants)
    except (MeshError, SceneError) as error:
        # As where data are given cell by cell, or finer cells would move from where the run begins.
        log.info("error_bound: the path is on the cells of the run: %s", error)
    return whole, inner, whole.path(history, instants)
