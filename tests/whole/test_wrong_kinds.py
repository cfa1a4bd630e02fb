"""An argument of a wrong kind raises an error that names the argument.

Damaged files are read, or raise errors with a sentence.

Every parameter of every public callable receives the values of `WRONG`.
"""

from __future__ import annotations

import datetime
import decimal
import inspect
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import hostile
import numpy as np
import pytest
import scipy.sparse as sp

import vemcvx as vx


class Hostile:
    """An object whose every method raises an error."""

    def _refuse(self, *_, **__):
        raise RuntimeError("hostile")

    __array__ = __float__ = __int__ = __index__ = __len__ = __iter__ = __bool__ = __eq__ = _refuse
    __hash__ = None


def make_endless():
    """Return a list that contains itself."""
    inner = []
    inner.append(inner)
    return inner


def exhaust(*_):
    raise MemoryError


FUNCTIONS = {
    "without arguments": lambda: 1.0,
    "gives None": lambda *_: None,
    "gives words": lambda *_: "1",
    "gives NaN": lambda *_: np.nan,
    "gives masked": lambda *_: np.ma.masked_array([1.0, 2.0], [False, True]),
    "gives hostile": lambda *_: Hostile(),
    "exits": lambda *_: sys.exit(0),
    "out of memory": exhaust,
}
WRONG = {
    "NaN": lambda: np.nan,
    "infinity": lambda: np.inf,
    "bytes": lambda: b"",
    "a set": lambda: {1.0},
    "an object": object,
    "complex": lambda: 1j,
    "Decimal": lambda: decimal.Decimal(1),
    "datetime": lambda: datetime.datetime(2020, 1, 1),
    "timedeltas": lambda: np.array([3, 4], dtype="m8[s]"),
    "datetimes": lambda: np.array(["2020-01-01"], dtype="M8[D]"),
    "a masked array": lambda: np.ma.masked_array([1.0, 2.0], [False, True]),
    "masked": lambda: [np.ma.masked, 1.0],
    "an array of words": lambda: np.array(["a", "b"]),
    "an array of objects": lambda: np.array([object()]),
    "a record": lambda: np.zeros(2, dtype=[("a", float)]),
    "an array of one word": lambda: np.array("a"),
    "a cube": lambda: np.zeros((3, 3, 3)),
    "ragged": lambda: [[1.0], [1.0, 2.0]],
    "endless": make_endless,
    "a generator": lambda: (x for x in (1.0, 2.0)),
    "hostile": Hostile,
    "hostile inside": lambda: [Hostile()],
    **{name: (lambda f=function: f) for name, function in FUNCTIONS.items()},
}
ANY_FUNCTION = {"Norms.places", "Limits.places", "Kernel.in_words"}
"""Parameters that accept any function; vemcvx calls the function for messages only."""

MESH, CUBE = vx.meshes.squares(1), vx.meshes.cubes(1)
STEEL, HELD = vx.Elasticity(200.0, 0.3), vx.Clamp("right")
PUSH = vx.Traction(lambda x, t: np.tile([t, -t], (len(x), 1)), "left")
GRIPPED = vx.BilateralContact("bottom"), vx.TrescaFriction(0.1, "bottom")
SCENE, TIMES = vx.Scene(STEEL, HELD, PUSH, *GRIPPED), [0.0, 1.0]
K, FREE = np.array([[4.0, -1.0], [-1.0, 3.0]]), np.array([[1.0, -1.0], [-1.0, 1.0]])


def load(t):
    return np.array([t, -2 * t])


def run(made):
    """Simulate a scene with the effect `made`."""
    beside = {
        vx.TrescaFriction: (HELD, GRIPPED[0]),
        vx.CoulombFriction: (HELD, vx.UnilateralContact("bottom")),
        vx.SpeedFriction: (HELD, GRIPPED[0]),
    }.get(type(made), (HELD,))
    material = () if type(made) in (vx.Elasticity, vx.Orthotropic) else (STEEL,)
    initial = None if isinstance(made, (vx.Viscosity, vx.VelocityContact)) else "settled"
    return vx.simulate(vx.Scene(made, *material, *beside, PUSH), MESH, TIMES, initial=initial)


def march(**parts):
    return vx.march(vx.System(**{"K": K, "load": load, **parts}), TIMES)


HISTORY = vx.simulate(SCENE, MESH, TIMES)
GIVEN = {
    "on": "left", "young": 200.0, "poisson": 0.3, "shear": 1.0, "force": (1.0, 0.0), "at": (0.0, 0.0), "value": 1.0,
    "stress": (1.0, 0.0, 0.0), "expansion": 1e-3, "temperature": 1.0, "stiffness": 40.0, "bound": 0.1,
    "coefficient": 0.1, "scene": SCENE, "mesh": MESH, "times": TIMES, "system": vx.System(K, load), "K": K,
    "load": load, "B": np.eye(2), "w": [0.1, 0.2], "D": np.eye(2), "e": [0.1, 0.2], "C": np.eye(2),
    "weights": lambda t, p, past, slip: np.zeros(2), "modes": np.ones((2, 1)), "names": ("all",), "solver": "CLARABEL",
    "displacement": lambda x, t: 0 * x, "values": [0.0, 1.0], "history": HISTORY, "histories": [HISTORY],
    "program": next(vx.programs(SCENE, MESH, TIMES)), "path": Path(tempfile.mkdtemp()) / "step.npz",
    "scene_of": lambda theta: vx.Scene(vx.Elasticity(theta[0], 0.3), HELD, PUSH, *GRIPPED), "theta": [200.0],
    "theta_0": [200.0], "of": ["energy"], "measured": {"energy": [0.0, 0.002]},
    "radii": [0.5, 1.0], "sectors": 4, "heights": TIMES,
    "points": MESH.points, "cells": MESH.cells, "name": "a", "h": [1.0, 0.5], "errors": [1.0, 0.5], "step": 1,
    "predicate": lambda x: x[:, 0] > 0.9, "start": (0, 0),
    "end": (1, 1), "run": HISTORY, "reference": HISTORY, "boundaries": {"a": [[0, 1]]},
    "meshes": {"lower": MESH, "upper": vx.meshes.squares(1, ((0, 1), (1, 2)))},
}  # fmt: skip
"""Name -> valid value of a parameter without a default."""
OTHERS = {
    vx.adapt: {"target": 0.9},
    vx.limit_load: {"scene": vx.Scene(STEEL, *GRIPPED), "load": PUSH},
    vx.Orthotropic: {"young": (2.0, 1.0)},
    vx.PrescribedDisplacement: {"value": (1.0, 0.0)},
    vx.TrescaFriction: {"on": "bottom"},
    vx.CoulombFriction: {"on": "bottom"},
    vx.SpeedFriction: {"on": "bottom", "bound": lambda speed: 0.1 + speed},
    vx.PolyhedralMesh: {"points": CUBE.points, "cells": CUBE.cells},
    HISTORY.reaction: {"name": "right"},
    HISTORY.table: {"name": "steps"},
    HISTORY.probe: {"points": [(0.5, 0.5)]},
}
USES = {
    vx.Scene: lambda made: None,
    vx.Norms: lambda made: march(norms=made),
    vx.Law: lambda made: march(norms=vx.Norms(np.eye(2), 0.0, law=made)),
    vx.Limits: lambda made: march(limits=made),
    vx.Damping: lambda made: march(damping=made),
    vx.Kernel: lambda made: vx.march(vx.System(FREE, lambda t: [t, -t], vx.Norms(np.eye(2), 0.1), kernel=made), TIMES),
    vx.System: lambda made: vx.march(made, TIMES),
    vx.projected: lambda made: vx.simulate(SCENE, MESH, TIMES, initial=made),
    vx.Tabulated: lambda made: made(None, 0.5),
    vx.programs: list,
    vx.programs_of_march: list,
}
OF_RUNS = (
    *(vx.History, vx.Contact, vx.Trajectory, vx.Adapted, vx.ErrorBound, vx.ErrorBudget, vx.Quantity),
    *(vx.LimitLoad, vx.Shakedown, vx.Sensitivities, vx.Fit),
)
OF_SOLVERS = vx.QuantityBound, vx.Operators, vx.StepProgram, vx.SolvedProgram, vx.Answer, vx.Certificate
"""Records that runs and solvers return; they are not tested here."""
LEFT = {"progress", "stream", "folder", "effects"}
"""Parameters that are not tested: `progress` (any function), paths of output, and the effects of a scene."""
METHODS = (
    *(MESH.with_boundary, MESH.refine, MESH.extruded, CUBE.with_boundary, CUBE.refine),
    *(HISTORY.stress, HISTORY.von_mises, HISTORY.row, HISTORY.reaction, HISTORY.probe, HISTORY.table),
)
SEEDED = {"distorted", "hanging", "voronoi", "prisms", "voronoi3"}
"""Families of random meshes; all other families accept any `seed`."""
FAMILIES = {**vx.meshes.FAMILIES, **vx.meshes.SPACE_FAMILIES}
CALLABLES = (
    *(thing for name in vx.__all__ if callable(thing := getattr(vx, name)) and not inspect.isabstract(thing)),
    *FAMILIES.values(),
    *(vx.meshes.l_shape, vx.meshes.ring, vx.meshes.bodies),
    *(getattr(vx.measures, name) for name in ("orders", "convergence_table", "energy_distance", "l2_error")),
    *METHODS,
)


def use(called, made):
    """Use the result of a callable in a run."""
    if called in USES:
        USES[called](made)
    elif isinstance(made, vx.Effect):
        run(made)
    elif isinstance(made, vx.Solver):
        vx.simulate(vx.Scene(*list(SCENE)[: 3 if isinstance(made, vx.Direct) else None]), MESH, TIMES, solver=made)
    elif isinstance(made, vx.LinearSolver) and not isinstance(made, vx.PETSc):
        vx.simulate(SCENE, MESH, TIMES, linear=made)


def list_places():
    """Yield pairs: a name, and a triple (callable, valid arguments, parameter to test)."""
    for called in CALLABLES:
        is_error = inspect.isclass(called) and issubclass(called, BaseException)
        if is_error or called in (*OF_RUNS, *OF_SOLVERS, vx.Stabilisation):
            continue
        parameters = inspect.signature(called).parameters
        needed = {name for name, one in parameters.items() if one.default is one.empty}
        given = {name: GIVEN[name] for name in needed - LEFT} | OTHERS.get(called, {})
        is_drawn = called in FAMILIES.values() or called is vx.meshes.l_shape
        given |= {"n": 1} if is_drawn else {}
        left = LEFT | ({"seed"} if is_drawn and called.__name__ not in SEEDED else set())
        yield from ((f"{called.__qualname__}.{name}", (called, given, name)) for name in parameters if name not in left)


PLACES = dict(list_places())
EVERY = len(WRONG)
"""With this stride, each parameter receives one value of `WRONG`."""


@pytest.mark.long
def test_the_arguments_in_given_are_valid():
    for called, given in {called: given for called, given, _ in PLACES.values()}.items():
        # `read_program` needs a file, `Pretension` an interface between bodies, `Rigid` more than one cell.
        if called not in (vx.read_program, vx.Pretension, vx.Rigid):
            use(called, called(**given))


def check_place(place, every):
    called, given, parameter = PLACES[place]
    for name in list(WRONG)[list(PLACES).index(place) % every :: every]:
        # An infinite weight in `Norms` is valid.
        if (name in FUNCTIONS and place in ANY_FUNCTION) or (name, place) == ("infinity", "Norms.w"):
            continue
        try:
            use(called, called(**{**given, parameter: WRONG[name]()}))
        except vx.VemcvxError as error:
            said = str(error).lower()
        except BaseException as error:
            raise AssertionError(f"{name}: {type(error).__name__}: {error}") from error
        else:
            raise AssertionError(f"{name} was accepted")
        subject = parameter.rstrip("s").split("_")[-1].lower()
        assert subject in said or called.__name__.lower() in said or (called is vx.Law and "norms: w" in said), said


@pytest.mark.parametrize("place", PLACES)
def test_an_argument_of_a_wrong_kind_is_refused_by_name(place):
    check_place(place, EVERY)


@pytest.mark.slow
@pytest.mark.parametrize("called", sorted({place.split(".")[0] for place in PLACES}))
def test_arguments_of_all_wrong_kinds_are_refused_by_name(called):
    for place in PLACES:
        if place.split(".")[0] == called:
            check_place(place, 1)


@pytest.mark.parametrize("wrong", [10**6, -1])
@pytest.mark.parametrize("part", ["indices", "indptr"])
def test_sparse_matrices_with_indices_out_of_range_are_refused(part, wrong):
    """SciPy would read and write outside of its arrays."""
    bad = sp.csr_matrix(2 * np.eye(4))
    getattr(bad, part)[2] = wrong
    for act in (lambda: vx.System(bad, lambda t: np.ones(4)), lambda: vx.Norms(bad, 1.0), lambda: vx.Limits(bad, 1.0)):
        with pytest.raises(vx.SceneError, match="found a sparse matrix with invalid indices"):
            act()


def write_files(folder):
    """Write valid files, and return kind of reader -> paths."""
    HISTORY.write(folder / "out")
    vx.write_program(GIVEN["program"], folder / "program.npz")
    vx.meshes.voronoi(2).write(folder / "plane.vtu")
    vx.meshes.kelvin(1).write(folder / "space.vtu")
    return {
        "history": [folder / "out" / "history.npz"],
        "program": [folder / "program.npz"],
        "mesh": [folder / "plane.vtu", folder / "space.vtu"],
    }


@pytest.mark.parametrize("count", [pytest.param(10, marks=pytest.mark.long), pytest.param(250, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["history", "program", "mesh"])
def test_damaged_files_are_read_or_raise_errors_with_a_sentence(kind, count, tmp_path):
    """The process that reads the files must not crash, hang or fill the memory."""
    rng, paths = np.random.default_rng(count), []
    for valid in write_files(tmp_path)[kind]:
        for k in range(count):
            damage = hostile.mutated_archive if valid.suffix == ".npz" and k % 2 else hostile.mutated
            paths.append(tmp_path / f"{k}_{valid.name}")
            paths[-1].write_bytes(damage(valid.read_bytes(), rng))
    said = [words for k in range(0, len(paths), 50) for words in hostile.read_all(paths[k : k + 50], kind)]
    assert len(said) == len(paths)
    assert sum(map(bool, said)) > len(paths) / 4


@pytest.mark.parametrize("wrong", [np.inf, np.nan])
def test_fields_that_are_not_finite_are_not_written(tmp_path, wrong):
    displacement = HISTORY.displacement.copy()
    displacement[1, 3, 0] = wrong
    with pytest.raises(vx.HistoryError, match="write: found NaN or infinite displacements"):
        replace(HISTORY, displacement=displacement).write(tmp_path / "out")
    assert not (tmp_path / "out").exists()
