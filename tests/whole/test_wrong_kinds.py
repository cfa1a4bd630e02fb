"""Whatever is handed in, wherever: one sentence of the package's own, and no warning.

Every parameter of everything public meets every value of :mod:`wrong_kinds`; what is right there after all is named.
"""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from wrong_kinds import HELD, MESH, PUSH, STEEL, WRONG, K, load, marched, run

import vemcvx as vx

GRIPPED = vx.BilateralContact("bottom"), vx.TrescaFriction(0.1, "bottom")
SCENE = vx.Scene(STEEL, HELD, PUSH, *GRIPPED)
CUBE = vx.meshes.cubes(1)
PAIR = {"lower": MESH, "upper": vx.meshes.squares(1, ((0, 1), (1, 2)))}
FREE = np.array([[1.0, -1.0], [-1.0, 1.0]])
NONE = np.zeros(2)

# Kinds of setting, by what of WRONG is right for them. Flags in arrays are the numbers 0 and 1.
NAMES = {"a word", "a number in words", "a flag in words"}
VALUES = {"flags", "an array", "negative"}
FUNCTIONS = {name for name, make in WRONG.items() if callable(make())}
NOTHING = {"no list", "no dict", "no array"}


def settled(*effects):
    return run(STEEL, HELD, *effects, initial="settled")


def solved(solver):
    return run(STEEL, HELD, PUSH, *GRIPPED, solver=solver)


def with_norms(norms):
    return marched(vx.System(K, load, norms))


def with_kernel(kernel):
    return marched(vx.System(FREE, lambda t: [t, -t], vx.Norms(np.eye(2), 0.1), kernel=kernel))


ON = "bottom"
# What to make, its parameters, what to do with it; parameters for which something of WRONG is right.
MADE = [
    (vx.Elasticity, {"young": 200.0, "poisson": 0.3, "plane": "strain", "stabilisation": "shear", "on": None},
     lambda made: run(made, HELD, PUSH), {"on": {"None"}, "plane": {"None"}}),
    (vx.Orthotropic, {"young": (2.0, 1.0), "poisson": 0.3, "shear": 0.5, "angle": 0.0, "plane": "stress",
                      "axes": None, "on": None, "stabilisation": "shear"},
     lambda made: run(made, HELD, PUSH), {"on": {"None"}, "young": {"an array"}, "angle": {"negative"},
                                          "plane": {"None"}, "axes": {"None"}}),
    (vx.Clamp, {"on": "right"}, lambda made: run(STEEL, made, PUSH), {}),
    (vx.Symmetry, {"on": ON}, lambda made: run(STEEL, HELD, made, PUSH), {}),
    (vx.BilateralContact, {"on": ON}, lambda made: run(STEEL, HELD, made, PUSH), {}),
    (vx.UnilateralContact, {"on": ON, "gap": 0.0}, lambda made: run(STEEL, HELD, made, PUSH), {"gap": VALUES}),
    (vx.NormalCompliance, {"stiffness": 40.0, "on": ON, "gap": 0.0}, lambda made: run(STEEL, HELD, made, PUSH),
     {"stiffness": VALUES, "gap": VALUES}),
    (vx.TrescaFriction, {"bound": 0.1, "on": ON, "quadrature": "nodes", "while_closed": None, "ground": None,
                         "direction": None, "across": None},
     lambda made: run(STEEL, HELD, PUSH, GRIPPED[0], made),
     {"bound": VALUES, "while_closed": {"None"}, "ground": {"None"},
      "direction": {"None"}, "across": {"None"}}),
    (vx.CoulombFriction, {"coefficient": 0.1, "on": ON, "cap": None, "ground": None, "direction": None,
                          "across": None},
     lambda made: run(STEEL, HELD, PUSH, vx.UnilateralContact(ON), made),
     {"coefficient": VALUES, "cap": VALUES | {"None"}, "ground": {"None"}, "direction": {"None"},
      "across": {"None"}}),
    (vx.Traction, {"force": (1.0, 0.0), "on": "left"}, settled, {"force": VALUES}),
    (vx.projected, {"displacement": lambda x, t: 0 * x},
     lambda made: vx.simulate(SCENE, MESH, [0.0, 1.0], initial=made), {}),
    (vx.Tabulated, {"times": [0.0, 1.0], "values": [0.0, 1.0]}, lambda made: made(None, 0.5),
     {"values": {"flags", "an array"}}),
    (vx.Pressure, {"value": 1.0, "on": "left"}, settled, {"value": VALUES}),
    (vx.PointLoad, {"force": (1.0, 0.0), "at": (0.0, 0.0)}, settled, {"force": VALUES, "at": VALUES}),
    (vx.BodyForce, {"force": (1.0, 0.0)}, settled, {"force": VALUES}),
    (vx.Prestress, {"stress": (1.0, 0.0, 0.0)}, settled, {}),
    (vx.PrescribedDisplacement, {"value": 0.0, "on": "left", "direction": "normal"}, settled,
     {"value": VALUES, "direction": VALUES}),
    (vx.ElasticFoundation, {"normal": 1.0, "tangential": 1.0, "on": ON}, lambda made: run(STEEL, HELD, made, PUSH),
     {"normal": VALUES, "tangential": VALUES}),
    (vx.ThermalStrain, {"expansion": 1e-3, "temperature": 1.0}, settled,
     {"expansion": VALUES, "temperature": VALUES}),
    (vx.Viscosity, {"shear": 1.0, "volume": 1.0}, lambda made: run(STEEL, HELD, PUSH, made), {}),
    (vx.Norms, {"B": np.eye(2), "w": [0.1, 0.2], "block": 1, "places": None, "law": None, "ground": None},
     with_norms,
     {"B": {"a sparse matrix"}, "w": VALUES | {"a class"}, "places": FUNCTIONS | {"None"}, "law": {"None"},
      "ground": {"None"}}),
    (vx.Law, {"weights": lambda t, p, past, slip: p, "softening": None, "pressed": False, "slope": None, "slips": True},
     lambda made: with_norms(vx.Norms(np.eye(2), 0.0, law=made)), {"softening": VALUES | {"None"}, "slope": {"None"}}),
    (vx.Limits, {"D": np.eye(2), "e": [0.1, 0.2], "compliance": 0.0, "places": None},
     lambda made: marched(vx.System(K, load, limits=made)),
     {"D": {"a sparse matrix"}, "e": VALUES | {"a class"}, "compliance": VALUES, "places": FUNCTIONS | {"None"}}),
    (vx.Damping, {"C": np.eye(2), "motion": None}, lambda made: marched(vx.System(K, load, damping=made)),
     {"C": {"a sparse matrix"}, "motion": {"None"}}),
    (vx.Kernel, {"modes": np.ones((2, 1)), "names": ("all",), "in_words": None}, with_kernel,
     {"in_words": FUNCTIONS | {"None"}}),
    (vx.System, {"K": K, "load": load, "norms": vx.Norms(np.eye(2), 0.1), "motion": None, "order": None,
                 "near_kernel": None, "kernel": None, "limits": None, "damping": None, "dragged": None}, marched,
     {"K": {"a sparse matrix"}, "order": {"None", "flags"}}
     | {key: {"None"} for key in ("norms", "motion", "near_kernel", "kernel", "limits", "damping", "dragged")}),
    (vx.Newton, {"accuracy": 1e-8, "max_iterations": 9}, solved, {"max_iterations": {"huge"}}),
    (vx.Direct, {"accuracy": 1e-8}, lambda made: run(STEEL, HELD, PUSH, solver=made), {}),
    (vx.Clarabel, {"accuracy": 1e-6, "polish": False, "options": {}, "tuned": True}, solved, {"options": {"no dict"}}),
    (vx.OSQP, {"accuracy": 1e-6, "polish": False, "options": {}, "tuned": True, "polygon": 4}, solved,
     {"options": {"no dict"}, "polygon": {"None", "huge"}}),
    (vx.ThroughCvxpy, {"solver": "CLARABEL", "accuracy": 1e-3, "polish": False, "options": {}, "tuned": True}, solved,
     {"options": {"no dict"}}),
    (vx.Iterative, {"tolerance": 1e-12, "max_iterations": 200},
     lambda made: run(STEEL, HELD, PUSH, linear=made), {"max_iterations": {"huge"}}),
    (vx.PETSc, {"tolerance": 1e-12, "max_iterations": 200},
     lambda made: run(STEEL, HELD, PUSH, linear=made), {"max_iterations": {"huge"}}),
]  # fmt: skip


def programs(**given):
    return list(vx.programs(**given))


def programs_of_march(**given):
    return list(vx.programs_of_march(**given))


CALLED = [
    (vx.march, {"system": vx.System(K, load), "times": [0.0, 1.0], "solver": None, "initial": None, "store": "all",
                "check": True, "condense": True, "linear": None, "storage": None},
     {"store": NOTHING | {"huge"}} | {key: {"None"} for key in ("solver", "initial", "linear", "storage")}),
    (vx.simulate, {"scene": SCENE, "mesh": MESH, "times": [0.0, 1.0], "solver": None, "initial": None, "store": "all",
                   "check": True, "condense": True, "linear": None, "resume": False, "bound": False},
     {"store": NOTHING | {"huge"}} | {key: {"None"} for key in ("solver", "initial", "linear")}),
    (programs, {"scene": SCENE, "mesh": MESH, "times": [0.0, 1.0], "solver": None, "initial": None, "check": True,
                "condense": True, "linear": None}, {key: {"None"} for key in ("solver", "initial", "linear")}),
    (programs_of_march, {"system": vx.System(K, load), "times": [0.0, 1.0], "solver": None, "initial": None,
                         "check": True, "condense": True, "linear": None},
     {key: {"None"} for key in ("solver", "initial", "linear")}),
    (vx.instants, {"scene": SCENE, "mesh": MESH, "times": [0.0, 1.0]}, {"times": {"an array"}}),
    (vx.adapt, {"scene": SCENE, "mesh": MESH, "times": [0.0, 1.0], "target": 0.9, "of": "energy", "solver": None,
                "initial": None, "most_unknowns": 4000, "theta": 0.6, "estimate": "residual"},
     {key: {"None"} for key in ("solver", "initial")}),
    (vx.write_program, {"program": next(vx.programs(SCENE, MESH, [0.0, 1.0])), "path": "step.words"}, {}),
    (vx.read_program, {"path": "step.npz"}, {}),
    (vx.meshes.squares, {"n": 2, "box": ((0, 1), (0, 1))}, {}),
    (vx.meshes.triangles, {"n": 2, "box": ((0, 1), (0, 1))}, {}),
    (vx.meshes.hexagons, {"n": 2, "box": ((0, 1), (0, 1))}, {}),
    (vx.meshes.l_shape, {"n": 2, "box": ((0, 1), (0, 1))}, {}),
    (vx.meshes.distorted, {"n": 2, "box": ((0, 1), (0, 1)), "seed": 0, "amount": 0.5}, {"seed": {"huge"}}),
    (vx.meshes.hanging, {"n": 2, "box": ((0, 1), (0, 1)), "seed": 0, "fraction": 0.3}, {"seed": {"huge"}}),
    (vx.meshes.nonconvex, {"n": 2, "box": ((0, 1), (0, 1)), "zigzag": 0.1}, {}),
    (vx.meshes.voronoi, {"n": 2, "box": ((0, 1), (0, 1)), "seed": 0, "cells": None, "relaxations": 1, "shortest": 0.0},
     {"cells": {"None"}, "seed": {"huge"}}),
    (vx.PolyhedralMesh,
     {"points": CUBE.points, "cells": CUBE.cells, "boundaries": None, "cell_data": None, "interfaces": None},
     {key: {"None", "no dict"} for key in ("boundaries", "cell_data", "interfaces")}),
    (vx.meshes.cubes, {"n": 2, "box": ((0, 1), (0, 1), (0, 1)), "size": None, "grade": 2.0}, {"size": {"None"}}),
    (vx.meshes.tetrahedra, {"n": 1, "box": ((0, 1), (0, 1), (0, 1)), "grade": 2.0}, {}),
    (
        vx.meshes.ring,
        {"radii": [0.5, 1.0], "sectors": 4, "angles": (0.0, 1.0)},
        {"radii": {"an array"}, "angles": {"an array"}},
    ),
    (vx.meshes.prisms, {"n": 1, "box": ((0, 1), (0, 1), (0, 1)), "seed": 0}, {"seed": {"huge"}}),
    (vx.meshes.kelvin, {"n": 1, "box": ((0, 1), (0, 1), (0, 1))}, {}),
    (vx.meshes.voronoi3, {"n": 1, "box": ((0, 1), (0, 1), (0, 1)), "seed": 0, "cells": None, "relaxations": 1},
     {"cells": {"None"}, "seed": {"huge"}}),
    (MESH.extruded, {"heights": [0.0, 1.0]}, {"heights": {"an array"}}),
    (CUBE.with_boundary, {"name": "a", "predicate": lambda x: x[:, 0] > 0.9}, {"name": NAMES}),
    (CUBE.with_boundaries, {"boundaries": {"a": [0]}}, {"boundaries": {"None", "no dict"}}),
    (vx.PolygonMesh, {"points": MESH.points, "cells": [[0, 1, 3, 2]], "boundaries": None, "cell_data": None,
                      "interfaces": None},
     {key: {"None", "no dict"} for key in ("boundaries", "cell_data", "interfaces")}),
    (vx.meshes.bodies, {"meshes": PAIR, "interfaces": None, "tolerance": None},
     {"interfaces": {"None", "no dict"}, "tolerance": {"None", "zero"}}),
    (vx.meshes.refinement, {"mesh": MESH, "cells": None, "balance": True}, {"cells": {"None", "no list", "no array"}}),
    (CUBE.refine, {"cells": None, "balance": True}, {"cells": {"None", "no list", "no array"}}),
    (vx.measures.orders, {"h": [1.0, 0.5], "errors": [1.0, 0.5]}, {key: {"an array"} for key in ("h", "errors")}),
    (vx.measures.convergence_table, {"h": [1.0, 0.5], "errors": [1.0, 0.5], "name": "h"},
     {"h": {"an array"}, "errors": {"an array"}, "name": NAMES | {"no words"}}),
    (MESH.with_boundary, {"name": "a", "predicate": lambda x: x[:, 0] > 0.9}, {"name": NAMES}),
    (vx.meshes.squares(2).cut, {"name": "a", "sides": {"b": [0, 1], "c": [2, 3]}}, {"name": NAMES}),
    (vx.meshes.cubes(2).cut, {"name": "a", "sides": {"b": [0, 1, 2, 3], "c": [4, 5, 6, 7]}}, {"name": NAMES}),
    (MESH.with_cell_data, {"name": "a", "values": [1.0]}, {"name": NAMES}),
]  # fmt: skip
PLACES = {
    f"{made.__name__}.{name}": (lambda v, m=made, g=given, n=name, u=use: u(m(**{**g, n: v})), right.get(name, set()))
    for made, given, use, right in MADE
    for name in given
} | {
    f"{called.__name__}.{name}": (lambda v, c=called, g=given, n=name: c(**{**g, n: v}), right.get(name, set()))
    for called, given, right in CALLED
    for name in given
}


def of_history(history):
    """What is asked of a history, and of two."""
    measures = vx.measures
    return {
        **{name: (getattr(history, name), set()) for name in ("stress", "von_mises", "row", "reaction", "probe")},
        "table": (history.table, set()),
        "points": (lambda v: history.table("probes", v), set()),
        "program": (history.program, set()),
        "condense": (lambda v: history.program(1, v), set()),
        "start": (lambda v: history.along(v, (1, 1)), {"flags"}),
        "end": (lambda v: history.along((0, 0), v), {"flags"}),
        "count": (lambda v: history.along((0, 0), (1, 1), v), set()),
        "field": (lambda v: history.along((0, 0), (1, 1), 3, v), set()),
        "budget": (vx.error_budget, set()),
        "bound": (vx.error_bound, set()),
        "bound's step": (lambda v: vx.error_bound(history, v), {"None"}),
        "bound's quantity": (lambda v: vx.error_bound(history, 1, v), {"None"}),
        "quantities": (vx.quantities, set()),
        "budget's steps": (lambda v: vx.error_budget(history, v), {"None", "flags"}),
        "error": (lambda v: measures.l2_error(history, v), VALUES),
        "distance": (lambda v: measures.energy_distance(v, history), set()),
        "kind": (lambda v: measures.energy_distance(history, history, kind=v), set()),
        "step": (lambda v: measures.energy_distance(history, history, step=v), set()),
        "time": (lambda v: measures.energy_distance(history, history, time=v), {"None"}),
        "common": (lambda v: measures.energy_distance(history, history, common=v), set()),
    }


def check(use, right, names):
    """Each of the values is refused in words of the package, or right."""
    for name in names:
        try:
            use(WRONG[name]())
        except vx.VemcvxError as error:
            said = str(error)
        except BaseException as error:
            raise AssertionError(f"{name}: {type(error).__name__}: {error}") from error
        else:
            said = name if name in right else ""
        assert said, f"{name} was accepted, or refused without a word"


EVERY = 6
"""By default each place meets every so many of the values; together they all occur."""


@pytest.mark.parametrize("place", PLACES)
def test_wrong_kinds_are_refused(place):
    use, right = PLACES[place]
    check(use, right, list(WRONG)[list(PLACES).index(place) % EVERY :: EVERY])


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_all_wrong_kinds_are_refused(place):
    check(*PLACES[place], WRONG)


@pytest.mark.long
def test_histories_refuse_wrong_kinds():
    for use, right in of_history(vx.simulate(SCENE, MESH, [0.0, 1.0])).values():
        check(use, right, WRONG)


def test_every_parameter_is_asked():
    """What is left out takes anything (progress), writes files, or is asked elsewhere; the list is short.

    Programs and their certificates are made by runs, and answers by solvers, which
    tests/whole/test_contributing.py asks.
    """
    made_by_runs = {
        "Adapted",
        "ErrorBound",
        "ErrorBudget",
        "Quantity",
        "QuantityBound",
        "Operators",
        "StepProgram",
        "SolvedProgram",
        "Answer",
        "Certificate",
    }
    asked = {place.partition(".")[0]: set() for place in PLACES}
    for place in PLACES:
        owner, _, name = place.partition(".")
        asked[owner].add(name)
    left = {
        f"{name}.{parameter}"
        for name in vx.__all__
        if callable(thing := getattr(vx, name))
        and not (inspect.isclass(thing) and issubclass(thing, (BaseException, vx.History, vx.Contact, vx.Trajectory)))
        and name not in {"Effect", "Solver", "LinearSolver", *made_by_runs}
        for parameter in inspect.signature(thing).parameters
        if parameter not in asked.get(name, ())
    }
    assert left == {
        *("Scene.effects", "march.progress", "simulate.progress", "simulate.stream", "adapt.progress"),
        *("error_bound.history", "error_bound.step", "error_bound.of", "error_budget.history", "error_budget.steps"),
        *("quantities.history", "read_history.folder"),
    }
