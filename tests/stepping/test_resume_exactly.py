"""A resumed run is the uninterrupted one in every field, to the bit; one of anything else is refused."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import get_type_hints

import interrupted
import numpy as np
import pytest
from identical import same
from interrupted import KINDS, RUBBED, TIMES, Kind, last_step
from scenes import paper_scene
from stopped import Stopped, stop_at

import vemcvx as vx
from vemcvx.archives import arrays_of, record_of
from vemcvx.program.certificate import Certificate
from vemcvx.program.operators import Norms
from vemcvx.program.system import Damping, DraggedTerms, Limits, Motion, System
from vemcvx.stepping import trajectory
from vemcvx.stepping.checkpoint import mark_of_data
from vemcvx.stepping.ledger import Ledger
from vemcvx.stepping.state import State
from vemcvx.weight_law import Law

SECONDS = ("seconds", "mesh", "scene")


def assert_same(one, other):
    """Every field of two records but what time they took, and the records in them."""
    for field in dataclasses.fields(one):
        if field.name not in SECONDS:
            a, b = getattr(one, field.name), getattr(other, field.name)
            assert_same(a, b) if dataclasses.is_dataclass(a) else _assert_equal(a, b, field.name)


def _assert_equal(a, b, name):
    # Rows of a folder are maps into files.
    assert same(np.array(a), np.array(b)) if isinstance(a, np.ndarray) else same(a, b), name


PROGRAM = """
import sys, interrupted, vemcvx.stepping.trajectory as trajectory
trajectory.BETWEEN = 0.0
interrupted.main(*sys.argv[1:])
"""
SLOW = [pytest.param(store, marks=pytest.mark.slow) for store in ("all", "last")]


@pytest.fixture(scope="module", params=["3", *SLOW])
def killed(request, tmp_path_factory):
    """Folders of runs that a signal has ended, and what they stored."""
    folder, store = tmp_path_factory.mktemp("killed"), request.param
    command = [sys.executable, "-c", PROGRAM, str(folder), store]
    subprocess.run(command, cwd=Path(interrupted.__file__).parent, check=True, stderr=subprocess.DEVNULL)
    return folder, int(store) if store.isdecimal() else store


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="there is no fork")
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@pytest.mark.parametrize("name", KINDS)
def test_a_killed_run_goes_on_as_if_it_had_not_been(killed, name):
    (folder, store), steps = killed, []
    resumed = KINDS[name].simulate(
        store=store, stream=folder / name, resume=True, progress=lambda n, _: steps.append(n)
    )
    assert steps[0] == last_step(name) + 1
    assert_same(KINDS[name].simulate(store=store), resumed)


def interrupt(kind, folder, step=9, **options):
    with pytest.raises(Stopped):
        kind.simulate(stream=folder, progress=stop_at(step), **options)


def test_records_are_kept_by_their_fields():
    """Also those that somebody adds, and records in them, which may be absent."""
    fields = [(name, Ledger | None, None) for name in ("inner", "other")]
    more = dataclasses.make_dataclass("More", fields, bases=(State,), frozen=True, kw_only=True)
    still = np.zeros((2, 1))
    certificate, some = Certificate(1.0, np.ones(2), 2.0), np.arange(4.0)
    ledger = Ledger(1.0, 2.0, 3.0, some, some, dissipated_second_order=4.0, worn_second_order=some)
    floats = [np.random.default_rng(k).normal(size=3) for k in range(6)]
    records = certificate, ledger, 1.5, 7, "so", 1, 0.5
    values = (0.5, *floats[:2], None, *floats[2:4], still, floats[4], still, *records)
    state = State(**dict(zip((field.name for field in dataclasses.fields(State)), values, strict=False)))
    told = {field.name: getattr(state, field.name) for field in dataclasses.fields(state)}
    made = more(**told, inner=ledger, other=None)
    found = record_of(more, dict(arrays_of(made, "data")), {"data": None})
    assert same(made, found)


class Watched:
    """A function that keeps count of its name when it is called."""

    def __init__(self, called, name, value):
        self.called, self.name, self.value = called, name, value

    def __call__(self, *_):
        self.called.add(self.name)
        return self.value


def test_all_data_are_looked_at():
    """Every function of a system, also one that somebody adds, but words and what follows from the others."""
    called, none = set(), np.zeros(1)

    def functions(kind, **others):
        hints = get_type_hints(kind)
        names = [field.name for field in dataclasses.fields(kind) if "Callable" in str(hints[field.name])]
        return kind(**{name: Watched(called, (kind, name), none) for name in names}, **others)

    motion = functions(Motion)
    parts = {
        "norms": functions(Norms, B=[[1.0]], law=functions(Law)),
        "limits": functions(Limits, D=[[1.0]]),
        "motion": motion,
        "dragged": functions(DraggedTerms, count=1),
        "damping": Damping([[1.0]], motion),
    }
    system = functions(System, K=[[1.0]], **parts)
    mark_of_data(system, 0.5)
    kinds = (System, Norms, Law, Limits, Motion, DraggedTerms)
    named = {(kind, name) for kind in kinds for name, hint in get_type_hints(kind).items() if "Callable" in str(hint)}
    implied = {(Norms, "places"), (Limits, "places"), (Law, "slope"), (Motion, "pair"), (System, "order")}
    assert named - called == implied


def paper(course=np.sin, bound=4.0, young=200.0, **options):
    """The paper's scene, or one that differs, and how it is simulated."""
    rest = paper_scene(course, bound).effects[1:]
    return Kind((vx.Elasticity(young, 0.3), *rest), "squares", options)


def pulse(t):
    """What differs from sin in one step between the first, the middle and the last."""
    return np.sin(t) * (1.1 if abs(t - TIMES[3]) < 1e-9 else 1.0)


def late(t):
    """What differs from sin in steps that are still to be made."""
    return np.sin(t) * (1.1 if t > 0.8 else 1.0)


VISCOUS = paper_scene(np.sin).with_(vx.Viscosity(9.0)).effects
CAPPED = (*RUBBED, vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom", cap=1.5))
OTHERS = {
    "loads at one instant": (paper(), paper(course=pulse), r"loads, supports or bounds at t = 0\.25"),
    "bound at one instant": (
        paper(bound=lambda x, t: 4.0),
        paper(bound=lambda x, t: 4.0 if t != TIMES[2] else 4.1),
        r"bounds at t = 0\.166667",
    ),
    "solver's settings": (paper(), paper(solver=vx.Newton(1e-9)), "solver"),
    "condense": (paper(), paper(condense=False), "condense or linear"),
    "initial": (paper(), paper(initial="settled"), "initial"),
    "store": (paper(), paper(store=3), "store"),
    "stiffness": (paper(), paper(young=201.0), "scene or mesh"),
    "damping": (
        Kind(VISCOUS, "squares"),
        Kind(paper_scene(np.sin).with_(vx.Viscosity(8.0)).effects, "squares"),
        "scene or mesh",
    ),
    "cap": (Kind(CAPPED), Kind((*CAPPED[:3], vx.CoulombFriction(0.3, on="bottom", cap=1.4))), r"bounds at t = 0"),
}


@pytest.mark.long
@pytest.mark.parametrize("what", OTHERS)
def test_whatever_differs_is_refused_and_named(tmp_path, what):
    one, other, words = OTHERS[what]
    interrupt(one, tmp_path)
    with pytest.raises(vx.HistoryError, match=f"run of another scene, mesh, times or store.*what differs: .*{words}"):
        other.simulate(stream=tmp_path, resume=True)
    # And nothing was harmed by asking.
    assert_same(one.simulate(), one.simulate(stream=tmp_path, resume=True))


@pytest.mark.long
def test_what_is_to_come_may_change(tmp_path):
    interrupt(paper(), tmp_path)
    resumed = paper(course=late).simulate(stream=tmp_path, resume=True)
    assert_same(paper(course=late).simulate(), resumed)


def truncated(file):
    file.write_bytes(file.read_bytes()[: -8 * 200])


def zeroed(file):
    rows = np.load(file)
    rows[2] += 1
    np.save(file, rows)


def shorter(file):
    np.save(file, np.load(file)[:4])


@cache
def uninterrupted():
    return paper().simulate()


@pytest.mark.long
@pytest.mark.parametrize("harm", [Path.unlink, truncated, zeroed, shorter], ids=lambda f: f.__name__)
@pytest.mark.parametrize("name", ["state", "scalars", "data"])
def test_rows_that_are_missing_are_said(tmp_path, harm, name):
    interrupt(paper(), tmp_path, step=11)
    harm(tmp_path / f"{name}.npy")
    with pytest.raises(vx.HistoryError, match=rf"{name}\.npy.*Run without resume"):
        paper().simulate(stream=tmp_path, resume=True)
    assert_same(uninterrupted(), paper().simulate(stream=tmp_path))


@pytest.mark.long
def test_a_run_that_stores_only_the_last_step_has_checkpoints(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(trajectory, "BETWEEN", 0.0)
    kind, steps = paper(store="last"), []
    interrupt(kind, tmp_path)
    with caplog.at_level("INFO", "vemcvx"):
        resumed = kind.simulate(stream=tmp_path, resume=True, progress=lambda n, _: steps.append(n))
    assert steps[0] == 10
    assert "going on after step 9 of 12" in caplog.text
    assert_same(kind.simulate(), resumed)
