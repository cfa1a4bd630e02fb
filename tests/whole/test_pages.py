"""The written pages of the site: their Python code runs, links and files exist, and values of constants are right."""

from __future__ import annotations

import re
from collections import Counter
from importlib import import_module
from itertools import pairwise

import numpy as np
import pytest
from texts import PAGES, ROOT, SITE, TEXTS, cells, files, is_made, page, prose
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
    """The cells run in an empty folder, like on the site; they assert the claims of their page."""
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


@pytest.mark.parametrize("path", PAGES, ids=name)
def test_headings_follow_in_order(path):
    """A page has one title, and skips no level of headings."""
    if path.stem == "changes":
        assert path.read_text() == "```{include} /CHANGELOG.md\n```\n"
        return
    levels = [len(marks) for marks in re.findall(r"^(#+) ", prose(path.read_text()), re.MULTILINE)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


def test_no_sentence_of_twelve_words_occurs_twice():
    """A text that needs a sentence of another text includes it by a directive."""
    said = Counter()
    for path in TEXTS:
        text = re.sub(r"\s+", " ", prose(path.read_text()))
        said.update(sentence for sentence in re.split(r"(?<=[.:;]) |\| ", text) if len(sentence.split()) >= 12)
    assert [sentence for sentence, times in said.items() if times > 1] == []


def test_the_page_of_measurements_has_the_values_of_constants():
    rows = re.findall(r"^\| (`[A-Z].*?), \{file\}`(vemcvx/\S+)\.py` \|", page("measurements"), re.M)
    assert len(rows) > 20
    for constants, module in rows:
        for name, value, eps in re.findall(r"`([A-Z_]+)` ([-\d.e]+)( eps)?", constants):
            found = getattr(import_module(module.replace("/", ".")), name)
            assert found == float(value) * (np.finfo(float).eps if eps else 1.0), f"{name} is {found}"


@pytest.mark.long
def test_the_problem_file_runs_as_described(tmp_path):
    """The pad of the file slips as a whole in the end: friction is the coefficient times the pressure."""
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
