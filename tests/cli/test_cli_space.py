"""Problem files in space: the families are those of space, the plane's own commands say that they are."""

from __future__ import annotations

import html
import sys

import pytest
from typer.testing import CliRunner

from vemcvx.cli import app, problem_file
from vemcvx.cli.problem_file import read_problem

BLOCK = '''"""A block dragged in space."""
import numpy as np
import vemcvx as vx


def scene(bound=4.0):
    return vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: [0.1 * np.sin(t), 0.1 - 0.1 * np.cos(t), 0.0], on="top"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


def mesh(n, family="cubes"):
    return vx.meshes.SPACE_FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)
'''


def invoked(tmp_path, *arguments):
    (tmp_path / "block.py").write_text(BLOCK)
    result = CliRunner().invoke(app, [arguments[0], str(tmp_path / "block.py"), *arguments[1:]])
    return result.exit_code, " ".join(result.output.split())


@pytest.mark.long
def test_commands_take_fewer_cells_in_space_when_nobody_says_how_many(tmp_path, monkeypatch):
    own = tmp_path / "own.py"
    own.write_text(BLOCK.replace('family="cubes"', 'family="own"').replace("SPACE_FAMILIES[family]", "cubes"))
    assert read_problem(own).family == "own"
    assert read_problem(own).default_n(64) == 8
    assert read_problem(own).default_n(4) == 4
    assert read_problem("feng_han_huang").default_n(64) == 64
    monkeypatch.setattr(problem_file, "SPACE_N", 2)
    for command in (["show"], ["run", "--steps", "1"], ["compare", "--steps", "1", "--solvers", "newton"]):
        code, said = invoked(tmp_path, *command)
        assert code == 0
        assert "8 cells, 27 nodes" in said


def test_show_says_discs_and_who_takes_them(tmp_path):
    code, said = invoked(tmp_path, "show", "--n", "2")
    assert code == 0
    assert "9 norms of 2 components, 9 second-order cones" in said
    assert "Elasticity: E = 200.0, nu = 0.3, shear stabilisation" in said
    assert "plane strain" not in said
    assert "OSQP (no second-order cones)" in said


@pytest.mark.long
def test_pictures_and_report_say_what_they_leave_out(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setitem(sys.modules, "pyvista", None)
    out = tmp_path / "out"
    code, said = invoked(tmp_path, "run", "--n", "2", "--steps", "2", "--plot", "--report", "--out", str(out))
    assert code == 0
    missing = "drawing bodies in space needs PyVista, which is not installed: pip install 'vemcvx[view]'"
    assert f"left out {missing}" in said
    files = {path.name for path in out.iterdir()}
    pictures = {
        "contact_face.png",
        "friction_disc.png",
        "hysteresis_loop.png",
        "forces_over_time.png",
        "energy_ledger.png",
        "report.html",
    }
    assert files >= pictures | {"history.pvd", "step_0002.vtu", "contact.csv", "summary.json"}
    page = html.unescape((out / "report.html").read_text())
    assert f"Left out: {missing}." in page
    assert page.count("<img") == 5
    assert "largest friction per area" in page
    assert "algebra" in page.split("Error budget")[1]
