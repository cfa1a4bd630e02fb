"""`messages.txt` lists calls. Below each call is the full sentence of the error.

`python tests/whole/test_messages.py` writes the errors anew below all calls of the file.
"""

from __future__ import annotations

import contextlib
import logging
import re
import shlex
import tempfile
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app

FILE = Path(__file__).with_name("messages.txt")
CALLS = [line for line in FILE.read_text().splitlines() if line and line[0] not in "# "]
K = np.array([[4.0, -1.0], [-1.0, 3.0]])


def run(*effects, mesh=None, times=(0.0, 1.0), **options):
    """Simulate effects, on a square of four cells unless a mesh is given."""
    return vx.simulate(vx.Scene(*effects), mesh or vx.meshes.squares(2), times, **options)


def load(t):
    return np.array([t, -2 * t])


def march(times=(0.0, 1.0), **parts):
    """March the system K u = load."""
    options = {key: parts.pop(key) for key in ("solver", "initial", "store", "linear") if key in parts}
    return vx.march(vx.System(**{"K": K, "load": load, **parts}), times, **options)


class ExitCode2(vx.VemcvxError):
    """The refusal that a command prints before it exits with code 2."""


def vemcvx(words):
    """Run a command in an empty folder, check that it writes no file, and raise its refusal."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        done = CliRunner().invoke(app, shlex.split(words))
        assert not any(path.is_file() for path in Path(folder).rglob("*"))
    if done.exit_code == 2:
        raise ExitCode2(
            done.output.strip().removeprefix("vemcvx: ").replace(str(FILE.parents[2]), "ROOT").replace("\\", "/")
        )


def list_names():
    """Return the names that calls of the file may use."""
    steel, held = vx.Elasticity(200.0, 0.3), vx.Clamp("right")
    pull = vx.Traction(lambda x, t: np.tile([t, -t], (len(x), 1)), "left")
    gripped = vx.BilateralContact("bottom"), vx.TrescaFriction(0.1, "bottom")
    mesh = vx.meshes.squares(2)
    given = {"steel": steel, "held": held, "pull": pull, "gripped": gripped, "mesh": mesh, "np": np, "sp": sp, "vx": vx}
    west, upper = mesh.centroids[:, 0] < 0.5, vx.meshes.squares(3, ((0, 1), (1, 2)))
    given |= {"halves": mesh.with_cell_data("west", west).with_cell_data("east", ~west), "cube": vx.meshes.cubes(1)}
    given |= {"history": run(steel, held, pull, *gripped), "solid": run(steel, held, mesh=given["cube"])}
    round_scene = (
        vx.Elasticity(200.0, 0.3, plane="axisymmetric"),
        vx.Symmetry("bottom"),
        vx.Pressure(lambda x, t: t, "right"),
    )
    given |= {"pair": vx.meshes.bodies({"lower": mesh, "upper": upper}), "turned": run(*round_scene)}
    operators = vx.Operators(np.eye(1), [[1.0]], D=[[1.0]])
    given |= {"operators": operators, "program": vx.StepProgram(operators, [2.0], [0.5], [0.0], [0.4])}
    given |= {"run": run, "march": march, "load": load, "K": K, "vemcvx": vemcvx}
    return given | {"folder": Path(tempfile.gettempdir()) / "not there"}


@pytest.fixture(scope="module")
def known():
    return list_names()


def quote_error(call, known):
    """Return the class and the sentence of the error that a call raises, indented."""
    with pytest.raises(vx.VemcvxError) as found:
        eval(call, dict(known))
    words = f"{type(found.value).__name__}: {found.value}".replace(tempfile.gettempdir(), "TMP")
    return "    " + re.sub(r"x[0-9A-Fa-f]{8,}", "x...", words).replace("\n", "\n    ")


def read_errors():
    """Return the error of each call of the file."""
    parts = {}
    for line in FILE.read_text().splitlines():
        if line in CALLS:
            parts[line] = []
        elif parts and line.startswith(" "):
            parts[CALLS[len(parts) - 1]].append(line)
    return {call: "\n".join(lines) for call, lines in parts.items()}


@pytest.mark.parametrize("call", CALLS)
def test_an_error_has_the_sentence_of_the_file(call, known):
    assert quote_error(call, known) == read_errors()[call], "python tests/whole/test_messages.py writes the file anew"


def test_sentences_end_with_a_full_stop_and_calls_are_unique():
    said = list(read_errors().values())
    assert len(said) == len(set(CALLS)) > 100
    assert [words for words in said if not words.endswith((".", ".vtu"))] == []


if __name__ == "__main__":
    logging.disable()
    told = list_names()
    lines = [line for line in FILE.read_text().splitlines() if not line.startswith("    ")]
    FILE.write_text("".join(f"{line}\n{quote_error(line, told)}\n" if line in CALLS else f"{line}\n" for line in lines))
