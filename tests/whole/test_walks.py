"""The walks of CONTRIBUTING.md against a trace: an unusual number is followed through all functions that are called."""

from __future__ import annotations

import importlib
import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import paper_load
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app
from vemcvx.solvers import conic

ROOT = Path(vx.__file__).parent
NUMBER = 4 * math.e / math.pi


def read_walks():
    """Return title -> {file: function}. A walk with "down to FILE" begins like the previous walk, up to FILE."""
    text = (ROOT.parent / "CONTRIBUTING.md").read_text()
    block = re.search(r"### Walks\n.*?```text\n(.*?)```", text, flags=re.DOTALL)[1]
    found, hops = {}, []
    for title, how, lines in re.findall(r"^(\w.*?)(?: \((.*)\))?\n((?:  .*\n)+)", block, flags=re.MULTILINE):
        last = re.search(r"down to (\S+\.py)", how)
        above = hops[: [file for file, _ in hops].index(last[1]) + 1] if last else []
        hops = above + re.findall(r"^  (\S+\.py) +(\S+)", lines, flags=re.MULTILINE)
        found[title] = dict(hops)
    return found


def make_finder(number):
    """Return a function that tells if 2^k * number, for some k, is an entry of an array or a matrix."""
    wanted = math.frexp(number)[0]

    def has(x):
        if isinstance(x, dict):
            return any(map(has, x.values()))
        if isinstance(x, (float, np.ndarray)) and np.size(x) < 5000 and np.asarray(x).dtype == float:
            return bool((np.abs(np.frexp(np.abs(np.ravel(x)))[0] - wanted) < 1e-14).any())
        return hasattr(x, "data") and hasattr(x, "indptr") and has(x.data)

    return has


def trace(run, has=None, since=None):
    """Return (file, name) of functions whose arguments, locals or results have the number, in the order of calls."""
    seen, here, has = {}, [since is None], has or make_finder(NUMBER)

    def profile(frame, event, answer):
        code = frame.f_code
        if event in ("call", "return") and code.co_filename.startswith(str(ROOT)):
            here[0] = here[0] or code.co_qualname == since
            place = Path(code.co_filename).relative_to(ROOT).as_posix(), code.co_qualname
            if here[0] and place not in seen:
                own = frame.f_locals.get("self")
                values = [answer, *frame.f_locals.values(), *getattr(own, "__dict__", {}).values()]
                if any(map(has, values)):
                    seen[place] = None

    sys.setprofile(profile)
    try:
        run()
    finally:
        sys.setprofile(None)
    return list(seen)


def scene(young=200.0, bound=4.0):
    return vx.Scene(
        vx.Elasticity(young, 0.0),
        vx.Clamp(on="right"),
        vx.Traction(paper_load(lambda t: t), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


def varying(x, t):
    return np.full(len(x), NUMBER)


def simulate(given, **options):
    return vx.simulate(given, vx.meshes.squares(4), [0.0, 0.5], **options)


def trace_bound_to_cone(folder):
    conic.list_installed()  # imports cvxpy before the trace begins
    return trace(lambda: simulate(scene(bound=varying), solver=vx.Clarabel(), condense=False), since="step")


def trace_bound_to_newton(folder):
    return trace(lambda: simulate(scene(bound=varying)), since="step")


def trace_young_to_stiffness(folder):
    return trace(lambda: simulate(scene(young=NUMBER)), since="Elasticity.contribute")


def trace_accuracy_to_step(folder):
    problem, accuracy = str(ROOT.parent / "problems" / "feng_han_huang.py"), repr(NUMBER * 2.0**-20)
    asked = ["run", problem, "--n", "2", "--steps", "1", "--solver", "clarabel", "--accuracy", accuracy]
    return trace(lambda: CliRunner().invoke(app, asked), make_finder(NUMBER))


def trace_displacement_to_file(folder):
    # With bound=4.0 the dissipation is the largest slip times a power of two; the finder ignores powers of two.
    given = scene(bound=3.0)
    history = simulate(given)
    largest = np.abs(history.displacement[-1][history.contact.nodes]).max()
    return trace(lambda: simulate(given).write(folder), make_finder(largest), since="StepProgram.rounding_floor")


WALKS = {
    "bound, from TrescaFriction to the cone": trace_bound_to_cone,
    "bound, from TrescaFriction to Newton's method": trace_bound_to_newton,
    "young, from Elasticity to K": trace_young_to_stiffness,
    "accuracy, from the command line to a step": trace_accuracy_to_step,
    "u, from the answer to a step to a VTU file": trace_displacement_to_file,
}
"""Title -> function that traces a run."""
RECORD = "effects/effect.py"
"""The file of records that hold functions and matrices; a trace does not look for the number inside records."""


def test_every_walk_is_traced():
    assert list(read_walks()) == list(WALKS)


@pytest.mark.long
@pytest.mark.parametrize("title", WALKS)
def test_a_walk_is_short_and_agrees_with_its_trace(title, tmp_path):
    hops, seen = read_walks()[title], WALKS[title](tmp_path)
    assert len(hops) <= 8
    for file, name in hops.items():
        module = importlib.import_module(f"vemcvx.{file.removesuffix('.py').replace('/', '.')}")
        assert hasattr(module, name.split(".")[0]), f"{file} has no {name}"
        is_seen = any(f"{where}.".startswith(f"{name}.") for at, where in seen if at == file)
        assert is_seen or file == RECORD, f"the number does not occur in {name}"
