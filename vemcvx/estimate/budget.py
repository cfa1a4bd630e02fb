"""The error of a run, part by part: the algebra, the mesh, the steps.

    total = algebra + space + time

algebra is certified: the steps' duality gaps added up (:attr:`vemcvx.History.certificate_total`). space is estimated
by the residuals below. time is the distance from the same run in finer steps, on the same mesh (:mod:`.finer_steps`).
All are relative energy errors: parts of the largest energy norm of the run; where nothing has moved, parts of the
estimate, because all is missing.

The mesh is judged by residual indicators of one state, cell by cell:

    eta_K^2 = c^2 (  h_K^2 / (9 mu) |f|^2_K                                          what the body force leaves
                   + sum over inner edges     d_e / (4 mu) |[sigma n]|^2_e / 2       jumps, half to each neighbour
                   + sum over boundary edges  d_e / (2 mu) |t - sigma n|^2_e )       loads, friction, contact, springs
              + the larger of
                     S_K(u - Pi u, u - Pi u)                                         the stabilisation, as in K
                     sum over edges  d_e E / 6 |eps_ss(u) - eps_ss(Pi u)|^2_e        strain along edges
              + what of the data was not assembled                              :mod:`vemcvx.bound.data_oscillation`

with sigma = C eps(Pi u) + sigma_0, E the modulus of a bar along the edge, and boundary residuals only in the
directions that supports leave free, at interfaces on the edges of both bodies (:mod:`vemcvx.bound.skeleton`). In the
order of Verfurth, *A Posteriori Error Estimation Techniques for Finite Element Methods* (2013), and of Cangiani,
Georgoulis, Pryer and Sutton, *A posteriori error estimates for the virtual element method* (Numer. Math. 137, 2017).
A ninth is of the Poincare inequality on a cell; c is declared below.

Lengths are those of the cell *across* the edge. A residual at e is tested with w = v - v_I, and the divergence of
(x - a) w^2 in the triangle T of e, the apex a and the height d gives

    |w|^2_e = 2 / d ( |w|^2_T + int_T w (x - a) . grad w )  <=  C d |grad w|^2_T     where |w|_T <= C d |grad w|_T,

as it is in meshes that are fine where things change fast. For d serves d_e, the width of the cell along n_e (the mean
of both cells): of a rectangle a side, of a triangle its height, and short edges have no d_e beyond the diameter. (With
.82 of the height estimates were .94 of the error on squares cut by both diagonals.) For h_K serves the longer side of
the rectangle with the cell's second moments. A stress that varies along a cell of the sides L and H jumps across its
*short* edges by L d(sigma)/dx; with |K|^{1/2} for d this counted (H / L)^{1/2} of its square, and estimates were .49 of
the error on the paper's scene with 128 x 4 squares.

Tractions do not contain eps_ss, the strain along an edge. Seen from both cells the strain eps_ss(u) is the same and
eps_ss(Pi u) is not; on a rectangle they differ by the variation of the strain that jumps do not see, H d(eps_xx)/dy and
L d(eps_yy)/dx. The stabilisation weighs both by H L, which is too little for the latter by L / H. The energy of a bar E
whose strain is linear between two opposite edges e is a sixth of the sum over them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from vemcvx.base.arrays import SAME, Floats, Ints, brief, plain, totals
from vemcvx.base.errors import HistoryError, SceneError
from vemcvx.base.outline import Outline, Outlined
from vemcvx.bound.data_oscillation import POINCARE, DataOscillation
from vemcvx.bound.skeleton import (
    Instant,
    Skeleton,
    check_estimable,
    instant,
    skeleton,
    strained,
    surface_forces,
    volume_squares,
)
from vemcvx.estimate.finer_steps import Finer, beside_finer
from vemcvx.estimate.in_space import Residuals
from vemcvx.estimate.quantities import quantities
from vemcvx.history import History, scene_of
from vemcvx.meshes.polygons import right_of
from vemcvx.results.quoted import Quantity
from vemcvx.results.results import displacement
from vemcvx.scene.pose import PosedScene, pose_scene
from vemcvx.stepping import Trajectory, prepare
from vemcvx.vem import cell_energies, elastic_matrix, tractions

CONSTANT = 0.63
"""c, of the residuals alone: what the projection misses and data count by their own energy.

Measured with estimates over true errors of the declared family (tests/shared/declared_cells.py: blocks with friction,
sheared and under weight, and beams, on squares of the aspects 1 to 100 and all other families of 1 to 16, both ways):
1.04 to 3.6, in the median 1.45. On manufactured full slip, for Poisson's ratios up to .4999995, they are 1.2 to 4.0 and
1.8, on the paper's scene 1.2 to 1.6 and 1.3."""


def indicators(posed: PosedScene, edges: Skeleton, oscillation: DataOscillation, now: Instant) -> dict[str, Floats]:
    """Squares (n_cells,) of the parts "volume", "jumps", "boundary", "stabilisation" and "data" of eta_K."""
    strain, sigma = strained(posed, now)
    missed = np.maximum(posed.material.missed(posed.space, now.u), _along(posed, edges, now.u, strain))
    return {
        "volume": CONSTANT**2 * POINCARE * volume_squares(posed, edges.sizes, edges.shear, now.t),
        "jumps": CONSTANT**2 * _jumps(edges, sigma),
        "boundary": CONSTANT**2 * _boundary(edges, sigma, surface_forces(posed, edges, now)),
        "stabilisation": missed,
        "data": oscillation.squares(now, strain),
    }


def _jumps(edges: Skeleton, sigma: Floats) -> Floats:
    one, two = edges.inside.T
    jump = tractions(sigma[one] - sigma[two], edges.inside_normals)
    length = np.linalg.norm(edges.inside_normals, axis=1)
    d = 0.5 * (edges.depths(one, edges.inside_normals) + edges.depths(two, edges.inside_normals))
    mu = 0.5 * (edges.shear[one] + edges.shear[two])
    part = d / (4.0 * mu) * np.einsum("ed,ed->e", jump, jump) / length
    return totals(edges.inside.ravel(), np.repeat(0.5 * part, 2), len(sigma))


def _boundary(edges: Skeleton, sigma: Floats, force: Floats) -> Floats:
    stress = tractions(sigma[edges.outer], edges.outer_normals)
    rest = force + edges.joints.normal_forces(stress, edges.weights, edges.units) - stress
    rest = np.einsum("bij,bj->bi", edges.free, rest)
    part = edges.weights * np.einsum("bd,bd->b", rest, rest) / edges.lengths
    return totals(edges.outer, part, len(sigma))


def require_same_form(posed: PosedScene, u: Floats) -> None:
    """Raise SceneError unless the stiffness is a^h of the material, by the energy of displacements (n_nodes, dim).

    An effect of one's own may bring a stiffness of one form and a material of another.
    """
    stiffness = posed.A if posed.springs is None else posed.A - posed.springs
    about = u - u.mean(axis=0)
    energy = float(about.ravel() @ (stiffness @ about.ravel()))
    material = posed.material
    parts = cell_energies(posed.space, material.moduli, material.stabilised(posed.space.dim), about)
    apart = abs(energy - float(parts.sum()))
    # What the energies of rotations, which are zero, are rounded by.
    rounding = 1e-14 * float(np.abs(about).ravel() @ (abs(stiffness) @ np.abs(about).ravel()))
    if apart > SAME * max(energy, float(parts.sum())) + rounding:
        raise SceneError(
            f"error_budget: the stiffness of the scene gives a state the energy {energy:.9g}, and {material.subject} "
            f"by its moduli and stabilisation {parts.sum():.9g}: they are not of one form a^h, and there is no "
            "estimate. Give the material's Contribution the stabilisation that its stiffness has, as "
            "Elasticity(stabilisation=...) does of any vx.Stabilisation."
        )


def _along(posed: PosedScene, edges: Skeleton, u: Floats, strain: Floats) -> Floats:
    """d_e E / 6 |eps_ss(u) - eps_ss(Pi u)|^2_e, added up over the edges of each cell."""
    sides, owner = edges.sides, edges.owner
    along = np.diff(posed.space.mesh.points[sides], axis=1)[:, 0]
    length = np.linalg.norm(along, axis=1)
    x, y = (along / length[:, None]).T
    dyad = np.column_stack([x * x, y * y, x * y])
    moved = np.einsum("ed,ed->e", np.diff(u[sides], axis=1)[:, 0], along) / length**2
    missed = moved - np.einsum("ek,ek->e", dyad, strain[owner])
    compliance = np.linalg.inv(elastic_matrix(posed.material.moduli))[owner]
    young = 1.0 / np.einsum("ei,eij,ej->e", dyad, compliance, dyad)
    part = edges.depths(owner, right_of(along)) * young / 6.0 * missed**2 * length
    return totals(owner, part, len(strain))


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ErrorBudget(Outlined):
    """Relative energy errors of a run, part by part.

    Attributes
    ----------
    steps : (S,) int
        The steps looked at.
    algebra, space, time : (S,)
        Certified, estimated and estimated: see :mod:`vemcvx.estimate.budget`.
    parts : mapping of str to (S,)
        The shares of space: "volume", "jumps", "boundary", "stabilisation" and "data", in space "pressure", too;
        space^2 is the sum of their squares.
    cells : (n_cells,)
        The largest eta_K (:mod:`vemcvx.estimate.budget`) of each cell over the steps looked at.
    added : (N,)
        What each step adds to the error of time: the norm of the change.
    jumps : tuple of str
        A sentence for each instant at which data jump.
    scale : float
        The energy norm to which all are relative, the root of force times length: the largest of the run, in which
        springs (ElasticFoundation) count as stiffness does. Measured errors (:class:`.measures.Measured`) are relative
        to the strain energy of the reference at one instant: where springs act, or the load is not at its largest, the
        two are not parts of one number.
    history : History
        The run.
    """

    steps: Ints
    algebra: Floats
    space: Floats
    time: Floats
    parts: dict[str, Floats]
    cells: Floats
    added: Floats
    jumps: tuple[str, ...]
    scale: float
    history: History

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """Friction work, work and wear of second order in the steps, with estimated errors: two more simulations.

        See :func:`vemcvx.quantities`.
        """
        return quantities(self.history)

    def outline(self) -> Outline:
        """The outline for prompts and notebooks: the parts where their sum is largest."""
        worst = self.steps[np.argmax(self.total)]
        parts = [(name, f"{value:.1e}") for name, value in self.largest.items()]
        return Outline(
            f"ErrorBudget: estimated relative energy errors at step {worst}, the largest of {len(self.steps)} steps",
            [*parts, *(("jump", words) for words in self.jumps)],
        )

    @property
    def total(self) -> Floats:
        """(S,) the sum of the three."""
        return self.algebra + self.space + self.time

    @property
    def largest(self) -> dict[str, float]:
        """The three parts and their sum, where the sum is largest."""
        worst = int(np.argmax(self.total))
        return {name: float(getattr(self, name)[worst]) for name in ("algebra", "space", "time", "total")}


def error_budget(history: History, steps: int | Sequence[int] | None = None) -> ErrorBudget:
    """Estimate the errors of a run: algebra, mesh and time steps.

    Parameters
    ----------
    history : History
    steps : int or sequence of int, optional
        Stored steps to examine; by default all but the initial instant.

    Raises
    ------
    HistoryError
        The history was read from files, so that its scene is not known.
    SceneError
        A step was not stored, or the scene has Viscosity or a PointLoad, for which there is no estimate.
    """
    scene = scene_of(history, "error_budget")
    posed = pose_scene(scene, history.mesh, history.trajectory.times.tolist())
    wanted = history.stored[history.stored > 0] if len(history.stored) > 1 else history.stored
    rows = [history.row(n) for n in (wanted.tolist() if steps is None else _whole_numbers(steps))]
    return budget_of(posed, history, rows)


def _whole_numbers(steps: int | Sequence[int]) -> list[int]:
    given = plain(steps)
    wanted = np.zeros(0) if given is None or given.dtype.kind not in "iuf" else np.atleast_1d(given)
    if wanted.ndim != 1 or len(wanted) == 0 or not np.all(np.abs(wanted) < 2**53) or np.any(wanted % 1):
        raise HistoryError(f"error_budget: found steps = {brief(steps)}; wanted numbers of stored steps, such as [-1].")
    return [int(n) for n in wanted]


def budget_of(posed: PosedScene, history: History, rows: Sequence[int], finer: Finer | None = None) -> ErrorBudget:
    """The budget of a run whose posed scene is at hand, at rows of its arrays; `finer` if that is known."""
    check_estimable(posed, "error_budget")
    require_same_form(posed, history.displacement[rows[-1]])
    run, of_state = history.trajectory, residuals(posed)
    squares = [of_state(instant(history, k)) for k in rows]
    steps = history.stored[np.asarray(rows, dtype=np.int64)]
    finer = in_time(posed, run) if finer is None else finer
    parts = {name: np.sqrt([part[name].sum() for part in squares]) for name in squares[0]}
    space = np.sqrt(np.sum([share**2 for share in parts.values()], axis=0))
    time = np.maximum.accumulate(finer.errors)[steps]
    scale = float(run.norm.max())
    unit = scale or float((space + time).max()) or 1.0
    return ErrorBudget(
        steps=steps,
        algebra=run.certificate_total[steps] * run.unit[steps] / unit,
        space=space / unit,
        time=time / unit,
        parts={name: share / unit for name, share in parts.items()},
        cells=np.sqrt(np.max([np.sum(list(part.values()), axis=0) for part in squares], axis=0)) / unit,
        added=finer.added / unit,
        jumps=finer.jumps,
        scale=scale,
        history=history,
    )


def residuals(posed: PosedScene) -> Callable[[Instant], dict[str, Floats]]:
    """Squares of the parts of eta_K of a state, in the plane or in space."""
    if not posed.space.in_plane:
        return Residuals(posed).indicators
    edges = skeleton(posed)
    return partial(indicators, posed, edges, DataOscillation(posed, edges))


def in_time(posed: PosedScene, run: Trajectory) -> Finer:
    """A run of a posed scene beside one in finer steps.

    What was left out because it is zero at the run's instants may act between them: nothing is left out here.
    """
    if run.initial is None:
        raise HistoryError("error_budget: this run does not say where it began; simulate the scene again.")
    whole = pose_scene(posed.scene, posed.space.mesh, between=run.times.tolist()) if posed.inactive else posed
    start, y = float(run.times[0]), run.initial
    if whole is not posed:
        y = whole.supports.gather(displacement(posed, y, start) - whole.supports.motion(start))
    return beside_finer(prepare(whole.system, None, False, True), run.times, y)
