"""The results of a simulation, with a summary, tables and files.

Stresses are positive in tension, contact pressures in compression. Friction forces and reactions act on the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Floats, brief
from vemcvx.base.errors import HistoryError
from vemcvx.base.outline import Lines, Outline, Outlined, count_steps
from vemcvx.program import SolvedProgram
from vemcvx.results.files import read_results, write_results
from vemcvx.results.probe import probe
from vemcvx.results.results import Results, programs_of_steps
from vemcvx.results.sections import Section, mean, section
from vemcvx.results.stages import join
from vemcvx.results.tables import Columns, dataset, frame, table
from vemcvx.scene import Scene

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


@dataclass(frozen=True, kw_only=True, repr=False)
class History(Results, Outlined):
    """The results of a simulation: N steps, S stored instants, and 2 or 3 dimensions (dim).

    Attributes
    ----------
    mesh : PolygonMesh or PolyhedralMesh
    scene : Scene or None
        None if the history was joined from stages, or read from files.
    effects : tuple of str
        The effects of the scene in words.
    displacement : (S, n_nodes, dim)
        Nodal displacements.
    forces : (S, n_nodes, dim)
        Nodal forces of supports, contact and friction on the body (:mod:`vemcvx.results.forces`).
    contact : Contact
    trajectory : Trajectory
        The results in free unknowns, and scalar results at all N + 1 instants.
    errors : dict or None
        Relative energy errors of an adaptive run: "algebra", "space", "time", "total" (the sum), "target" (requested).
    bound : dict or None
        With ``simulate(..., bound=True)``: "lower" and "upper" are bounds on the mesh error that one step adds, in
        the energy norm (:func:`vemcvx.error_bound`). "step": the step with the largest "upper". "relative":
        "upper" / (largest energy norm). "reading": the estimated part of "upper". "kind": as in `ErrorBound`.
    energy_bounds : (N + 1, 2) or None
        With `bound`: lower and upper bounds on the exact elastic energy of every step; NaN if unknown.
    cell_bounds : (n_cells,) or None
        With `bound`: the contributions of cells to the square of "upper".
    force_bounds : (N + 1, 2) or None
        With `bound`: lower and upper bounds on the force of a moving support; NaN if unknown.
    units : dict of str to str, or None
        Names of units, such as {"length": "mm"}.
    begins : {"given", "equilibrium", "settled", "projected", "continued"}
        The kind of `initial` in :func:`vemcvx.simulate`: "given" for nodal values, and after `read_history`.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="left"), vx.Traction((3.0, 0.0), on="right"))
    >>> history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled")
    >>> history.displacement.shape, [round(float(x), 9) + 0.0 for x in history.reaction("left")[-1]]
    ((2, 25, 2), [-3.0, 0.0])
    """

    begins: str = "given"

    @classmethod
    def from_results(cls, results: Results, begins: str = "given") -> History:
        """Return a history with the fields of `results`."""
        return cls(begins=begins, **{field.name: getattr(results, field.name) for field in fields(Results)})

    def probe(self, points: ArrayLike, field: str = "displacement") -> Floats:
        """Return a field (S, p, ...) at p points of the body, at all stored steps.

        Parameters
        ----------
        points : (p, dim) array
            Coordinates, such as ``np.linspace(start, end, 101)`` for points of a line.
        field : {"displacement", "stress", "out_of_plane_stress", "von_mises", "principal_stresses"}
            Stresses are constant on cells, and averaged where cells meet.

        Raises
        ------
        SceneError
            A point lies outside the body, or an argument is invalid.
        """
        return probe(self, points, field)

    def section(self, point: ArrayLike, normal: ArrayLike, on: str | Sequence[str] | None = None) -> Section:
        """Return the force and the moment across a plane through the body, at all stored steps.

        Parameters
        ----------
        point, normal : (dim,)
            A point of the plane, and a normal that points to the part ahead. In a plane body, the plane is a line.
        on : str or sequence of str, optional
            Names of cell data, such as names of bodies. Only cells with a nonzero datum are included.

        Returns
        -------
        Section
            ``force, moment = history.section(...)``: the force (S, dim) of the part ahead on the part behind, and the
            moment of this force about `point`, (S,) or in space (S, 3).

        Raises
        ------
        SceneError, HistoryError
            The plane does not cut the cells, an argument is invalid, the body is viscous or a body of revolution, or
            the stabilisation is unknown after reading files.

        Examples
        --------
        >>> bar = vx.meshes.squares((8, 2), box=((0, 4), (0, 1)))
        >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="left"), vx.Traction((3.0, 0.0), on="right"))
        >>> history = vx.simulate(scene, bar, [0.0, 1.0], initial="equilibrium")
        >>> force, moment = history.section((1.7, 0.5), (1.0, 0.0))
        >>> [round(float(x), 9) + 0.0 for x in force[-1]]
        [3.0, 0.0]
        """
        return section(self, point, normal, on)

    def mean(self, field: str = "stress", on: str | Sequence[str] | None = None) -> Floats:
        """Return the mean (S, ...) of a field over the body, or over some cells.

        Parameters
        ----------
        field : str
            As for `probe`. The mean of a displacement u is the mean of the projection Pi u.
        on : str or sequence of str, optional
            As for `section`: names of cell data.

        Raises
        ------
        SceneError
            There is no such field or cell datum, or the body is a body of revolution.
        """
        return mean(self, field, on)

    def table(self, name: str) -> Columns:
        """Return named columns of equal length: ``pandas.DataFrame(history.table("contact"))``.

        Parameters
        ----------
        name : {"steps", "contact"}
            "steps": energies, certificates and iterations of every step, stored or not. "contact": the arrays of
            :class:`vemcvx.Contact` at every contact node and stored step. Plane bodies also have the "piece" of the
            contact boundary and the arc length "s" on this piece (:mod:`vemcvx.results.arc`). Components of vectors are
            separate columns, such as "slip_x".

        Raises
        ------
        HistoryError
            There is no such table.
        """
        return table(self, name)

    def to_pandas(self, name: str = "steps") -> DataFrame:
        """Return a table as a DataFrame of pandas: see :meth:`table`."""
        return frame(table(self, name))

    def to_xarray(self) -> Dataset:
        """Return all arrays as one dataset of xarray, under their names in ``history.npz``.

        Dimensions are "step" (stored steps), "instant" (all instants), "node", "cell", "contact", "axis" and others. An
        example: ``history.to_xarray()["contact.slip"].sel(step=4, axis="x")``. Arrays have an attribute "units".
        """
        return dataset(self)

    def program(self, n: int, condense: bool = True) -> SolvedProgram:
        """Return the convex program of step `n`, with the solution and the certificate.

        :func:`vemcvx.programs` yields the programs of all steps with one factorisation.

        Parameters
        ----------
        n : int
            1 is the first step after the initial instant.
        condense : bool
            True: the program has the unknowns of friction and contact alone, and K is dense. False: all unknowns.

        Raises
        ------
        HistoryError
            There is no step `n`, the state before or after the step was not stored, or the history has no scene.
        """
        return next(programs_of_steps(self, [n], condense))

    def outline(self) -> Outline:
        """Return the summary that Python and Jupyter display."""
        return in_words(self)

    def summary(self) -> str:
        """Return a summary of the run in a few lines of text."""
        outline = self.outline()
        return "\n".join([outline.title, *(f"{name:<12}{words}" for name, words in outline.lines)])

    def write(self, folder: str | Path) -> Path:
        """Write the history to a folder: see :mod:`vemcvx.results.files`."""
        return write_results(self, folder)


def scene_of(history: object, subject: str) -> Scene:
    """Return the scene of a history, or raise HistoryError."""
    if not isinstance(history, History):
        raise HistoryError(f"{subject}: found {brief(history)}; wanted a History.")
    if history.scene is None:
        raise HistoryError(
            f"{subject}: this history was read from files or joined and has no scene; simulate again, or use one stage."
        )
    return history.scene


def read_history(folder: str | Path) -> History:
    """Read a history from a folder that :meth:`History.write` wrote; all numbers are recovered exactly.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    History
        `scene` is None, because data of a scene may be functions; `effects` describes the scene.

    Raises
    ------
    HistoryError
        The folder contains no history, or the history is damaged or of another format.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="left"), vx.Traction((3.0, 0.0), on="right"))
    >>> history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled")
    >>> bool((vx.read_history(history.write("run")).displacement == history.displacement).all())
    True
    """
    return History.from_results(read_results(folder))


def joined(histories: Sequence[History]) -> History:
    """Join the histories of stages into one history.

    A stage begins at the end of the previous stage: ``simulate(scene2, mesh, times2, initial=history1)``.
    Slip, wear, work and dissipated energy add up over the stages. Bounds and estimated errors are left out.

    Parameters
    ----------
    histories : sequence of History
        The stages in order of time, with all steps or every n-th step stored.

    Returns
    -------
    History

    Raises
    ------
    HistoryError
        An item is no history, or does not continue the previous history.

    Examples
    --------
    >>> pad, held = vx.meshes.squares(4), (vx.Elasticity(10.0, 0.3), vx.Clamp(on="bottom"))
    >>> press = vx.Pressure(lambda x, t: min(t, 1.0) + 0 * x[:, 0], on="top")
    >>> pull = vx.Traction(lambda x, t: [t - 1.0, 0.0] + 0 * x, on="right")
    >>> first = vx.simulate(vx.Scene(*held, press), pad, [0.0, 1.0])
    >>> second = vx.simulate(vx.Scene(*held, press, pull), pad, [1.0, 2.0], initial=first)
    >>> vx.joined([first, second]).times.tolist()
    [0.0, 1.0, 2.0]
    """
    stages = list(histories) if isinstance(histories, (list, tuple)) else []
    if not stages or not all(isinstance(stage, History) for stage in stages):
        raise HistoryError(
            f"joined: found {brief(histories)}; wanted a list of histories, one for each stage, in order of time."
        )
    return History.from_results(join(stages), stages[0].begins)


FOR_GIVEN = "for the given friction, whose bounds follow from the pressure and slip of the answer"


def in_words(history: Results) -> Outline:
    """Return the outline of a history."""
    run, touch = history.trajectory, history.contact
    row, at_end = history.row(None), history.peak == history.stored[-1]
    sticks, slips, opened = (int(count[row]) for count in (touch.stick_count, touch.slip_count, touch.open_count))
    touching = f"{sticks + slips} nodes touch, without friction"
    did = f"{sticks} nodes stick, {slips} slip" if touch.has_friction else touching
    did += f", {opened} are open" if opened else ""
    title = f"{history.mesh.n_cells} cells, {history.mesh.n_nodes} nodes, {run.state.shape[1]} unknowns, "
    title += f"{len(touch.nodes)} contact nodes, {count_steps(history.steps)}"
    median, above = int(np.median(run.iterations[1:])) if history.steps else 0, run.above_asked
    certified = f"{run.certified.max():.1e} relative energy error per step, rounding included; "
    certified += f"{run.certified_total.max():.1e} accumulated{above and f'; {above}'}"
    cost = f"median {median} per step, at most {run.iterations.max()}"
    quoted = f"dissipated {run.dissipated_second_order[-1]:.6g}, work {run.work_second_order[-1]:.6g}"
    when = "in the last step" if at_end else f"at t = {history.times[row]:.6g}, at the largest energy"
    most = "" if at_end else f" (at most {history.energy[row]:.6g}, at t = {history.times[row]:.6g})"
    lines = [
        *(("left out", words) for words in history.inactive),
        ("solver", history.solver),
        *([("units", ", ".join(map(" ".join, history.units.items())))] if history.units else []),
        *([("per turn", "forces, works and energies are per full turn")] if history.is_axisymmetric else []),
        ("certified", certified),
        *([("", FOR_GIVEN)] if run.given_friction.any() else []),
        *_errors(history.errors),
        *_bound(history.bound),
        *_quote_force(history),
        ("iterations", cost),
        ("energy", f"stored {run.energy[-1]:.6g}{most}, {quoted}, of second order in the step"),
        ("", f"sums of backward Euler: dissipated {run.dissipated[-1]:.6g}, work {run.work[-1]:.6g}, of first order"),
        *([("contact", f"{did} {when}")] if len(touch.nodes) else []),
        ("seconds", ", ".join(f"{name} {value:.3g}" for name, value in history.seconds.items())),
    ]
    return Outline(title, lines)


def _bound(bound: dict[str, Any] | None) -> Lines:
    if bound is None:
        return []
    words = f"{bound['lower']:.4g} ... {bound['upper']:.4g} in the energy norm, at most {bound['relative']:.2%}"
    words += f": the error of the mesh in step {bound['step']:.0f} (largest upper bound), if the step before is exact"
    return [("bounded" if bound["reading"] else "guaranteed", f"{words}; {bound['kind']}")]


def _quote_force(history: Results) -> Lines:
    if history.force_bounds is None or history.bounded_force is None:
        return []
    ((on, axis),), (low, high) = history.bounded_force.items(), history.force_bounds[-1]
    return [("", f"{low:.6g} ... {high:.6g} for the reaction of {on} along {'xyz'[axis]} in the last step")]


def _errors(errors: dict[str, float] | None) -> Lines:
    if errors is None:
        return []
    parts = ", ".join(f"{name} {errors[name]:.2%}" for name in ("algebra", "space", "time"))
    return [("estimated", f"{errors['total']:.2%} energy error ({parts}); the target was {errors['target']:.2%}")]
