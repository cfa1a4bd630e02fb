"""The Python code of the site's pages runs. Links and named files exist, and the values of constants are right."""

from __future__ import annotations

import re
from importlib import import_module

import numpy as np
import pytest
from texts import PAGES, ROOT, SITE, TEXTS, cells, files, is_made, page, prose
from typer.main import get_command
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app


def name(path):
    return path.relative_to(SITE).with_suffix("").as_posix()


RUN = [path for path in PAGES if cells(path.read_text())]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::vemcvx.base.errors.SceneWarning")
@pytest.mark.parametrize("path", RUN, ids=name)
def test_the_cells_of_a_page_run(path, tmp_path, monkeypatch):
    """The cells assert the claims of the page."""
    monkeypatch.chdir(tmp_path)
    known = {"__name__": "__main__"}
    for i, cell in enumerate(cells(path.read_text())):
        exec(compile(cell, f"{name(path)}, cell {i}", "exec"), known)


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_links_and_files_of_a_text_exist(path):
    text = prose(path.read_text())
    for target in re.findall(r"\]\(([^)#\s]+?\.\w+)(?:#[^)]*)?\)", text):
        if target.startswith("/pictures/"):
            assert (ROOT / "problems" / target[1:]).exists(), target
        elif not target.startswith("http"):
            named = (path.parent / target).resolve()
            assert named.exists() or is_made(named), target
    for named in re.findall(r"\{file\}`([^`]+)`", text):
        assert (ROOT / named).exists(), named


def test_commands_in_texts_have_existing_names_and_options():
    group = get_command(app)
    for path in TEXTS:
        for name, rest in re.findall(r"\bvemcvx ([a-z]+)\b(.*?)(?:`|$)", path.read_text(), re.MULTILINE):
            used = set(re.findall(r"(?<!\S)--[a-z][\w-]*", rest))
            known = {option for one in group.get_command(None, name).params for option in one.opts} if used else used
            assert used <= known | {"--help"}, f"{path.name}: {name} {used - known}"


def test_the_page_of_measurements_has_the_values_of_constants():
    rows = re.findall(r"^\| (`[A-Z].*?), \{file\}`(vemcvx/\S+)\.py` \|", page("measurements"), re.M)
    assert len(rows) > 20
    for constants, module in rows:
        for name, value, eps in re.findall(r"`([A-Z_]+)` ([-\d.e]+)( eps)?", constants):
            found = getattr(import_module(module.replace("/", ".")), name)
            assert found == float(value) * (np.finfo(float).eps if eps else 1.0), f"{name} is {found}"


@pytest.mark.long
def test_the_problem_file_runs_as_described(tmp_path):
    """At the end the whole pad slips, so friction is the coefficient times the pressure."""
    text = page("howto/problem_file")
    (tmp_path / "pad.py").write_text(files(text)["pad.py"])
    assert "$ vemcvx run pad.py --n 16" in text
    options = ["--n", "6", "--steps", "4", "--set", "coefficient=0.5", "--out"]
    done = CliRunner().invoke(app, ["run", str(tmp_path / "pad.py"), *options, str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    history = vx.read_history(tmp_path / "out")
    across, up = history.force("bottom")[-1]
    assert up > 0
    assert across == pytest.approx(-0.5 * up, rel=1e-8)
    assert not history.contact.sticking[-1].any()
