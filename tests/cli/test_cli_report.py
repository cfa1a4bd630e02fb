"""`vemcvx run --report` writes one self-contained page with the numbers of the summary and the command of the run."""

from __future__ import annotations

import base64
import json
import re
import shlex
from html.parser import HTMLParser

import pytest
from typer.testing import CliRunner

import feng_han_huang
import vemcvx as vx
from vemcvx.cli import app
from vemcvx.plots.style import in_units

pytest.importorskip("matplotlib")
LOOSE = '''
"""Hung <by> its top & "pulled" down.

Below stands a formula:

    1 < 2 & 3
"""
import numpy as np, vemcvx as vx
def scene(weight=0.1, note="</pre><script>alert(1)</script>", viscous=False):
    effects = [vx.Elasticity(1.0, 0.3), vx.Clamp(on="top"), vx.BodyForce(lambda x, t: [0.0, -weight * t] + 0 * x)]
    return vx.Scene(*effects, *([vx.Viscosity(0.1, 0.1)] if viscous else []))
def mesh(n):
    return vx.meshes.squares(n).with_boundary("<side>", lambda x: x[:, 0] < 0.1)
def times(steps):
    return np.linspace(0, 1, steps + 1)
'''
VOID = {"meta", "br", "img", "link", "input", "hr"}


class Reader(HTMLParser):
    """The words, tags and addresses of a page. A page whose tags are not closed in order fails."""

    def __init__(self, page):
        super().__init__()
        self.open, self.addresses, self.tags, self.words = [], [], [], []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.addresses += [value for name, value in attributes if name in ("src", "href", "srcset", "data", "action")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def write_report(folder, *arguments):
    """Run a command with --report; return the page and the output."""
    words = ["run", *map(str, arguments), "--report", "--out", str(folder)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["vemcvx", *words])
        done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[-1] == f"report      {folder / 'report.html'}"
    return (folder / "report.html").read_text(encoding="utf-8"), done.output


@pytest.fixture
def hung(tmp_path):
    (tmp_path / "hung&.py").write_text(LOOSE)
    return tmp_path / "hung&.py"


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    """Return the folder and the page of the paper's problem."""
    folder = tmp_path_factory.mktemp("paper")
    asked = "feng_han_huang", "--n", 6, "--steps", 20, "--set", "bound=3.5", "--store", 10
    return folder, write_report(folder, *asked)[0]


@pytest.mark.long
def test_the_page_is_self_contained(paper):
    read = Reader(paper[1])
    pictures = [address.removeprefix("data:image/png;base64,") for address in read.addresses]
    assert [base64.b64decode(data, validate=True)[:4] for data in pictures] == 10 * [b"\x89PNG"]
    assert not {"script", "link", "iframe", "object"} & set(read.tags)
    style = re.search("<style>(.*?)</style>", paper[1], re.DOTALL).group(1)
    assert not re.search(r"url\(|@import", style)


@pytest.mark.long
def test_the_page_has_the_numbers_of_the_summary(paper):
    told, text = json.loads((paper[0] / "summary.json").read_text()), Reader(paper[1]).text
    assert f"{told['mesh']['cells']} cells, {told['mesh']['nodes']} nodes, {told['unknowns']} unknowns" in text
    assert f"n = {told['mesh']['n']}: " in text
    lost, done = (told[f"{name}_second_order"] for name in ("dissipated", "work"))
    assert f"stored {told['energy']:.6g}, dissipated {lost:.6g}, work {done:.6g}, of second order" in text
    assert f"sums of backward Euler: dissipated {told['dissipated']:.6g}, work {told['work']:.6g}" in text
    assert f"certified {told['certified_energy_error']:.1e} relative energy error per step" in text
    for key, one in told["extremes"].items():
        place, unit = ", ".join(f"{x:.4g}" for x in one["place"]), in_units(one["unit"], feng_han_huang.UNITS)
        assert re.search(rf"{one['value']:.6g} {unit} at \({re.escape(place)}\), t = {one['t']:.6g} s", text), key
    for words in (*told["effects"], told["solver"], f"vemcvx {told['version']}", "algebra ", "space "):
        assert words in text


@pytest.mark.long
def test_the_command_on_the_page_repeats_the_run(paper, tmp_path):
    (command,) = re.findall(r">(vemcvx run feng_han_huang [^<]*)<", paper[1])
    words = shlex.split(command)[1:]
    words[words.index("--out") + 1] = str(tmp_path)
    assert CliRunner().invoke(app, [word for word in words if word != "--report"]).exit_code == 0
    one, other = (json.loads((folder / "summary.json").read_text()) for folder in (paper[0], tmp_path))
    for name in ("problem", "mesh", "steps", "effects", "energy", "dissipated", "solver", "certified_energy_error"):
        assert one[name] == other[name]
    assert '<th style="text-align:left">bound</th><td style="text-align:left">3.5</td>' in paper[1]


@pytest.mark.long
def test_texts_of_users_are_escaped(hung, tmp_path):
    read = Reader(write_report(tmp_path / "out", hung, "--n", 3, "--steps", 2)[0])
    assert not {"script", "by", "side"} & set(read.tags)
    assert 'hung&: Hung <by> its top & "pulled" down.' in read.text
    assert "1 < 2 & 3" in read.text
    assert "'</pre><script>alert(1)</script>'" in read.text
    # A problem file that names no units has consistent units. A scene without contact has no slip.
    assert "force/length²" in read.text
    assert "slip" not in read.text.split("Results")[1].split("Error budget")[0]
    assert read.tags.count("img") == 4


@pytest.mark.long
def test_the_page_gives_the_reason_for_a_missing_error_budget(hung, tmp_path):
    text = Reader(write_report(tmp_path, hung, "--n", 2, "--steps", 2, "--set", "viscous=True")[0]).text
    assert "Error budget There is no error budget. error_budget: there is no estimate for scenes with Viscosity" in text


def test_a_foreign_page_is_refused_before_the_run(hung, tmp_path):
    (tmp_path / "report.html").write_text("a thesis")
    refused = CliRunner().invoke(app, ["run", str(hung), "--n", "2", "--report", "--out", str(tmp_path)])
    assert refused.exit_code == 2
    assert "report.html: not made by a run of this version" in refused.output
    assert not (tmp_path / "summary.json").exists()


@pytest.mark.long
def test_units_of_a_problem_file_are_in_output_page_pictures_and_files(hung, tmp_path):
    units = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
    hung.write_text(f"{LOOSE}UNITS = {units!r}\n")
    page, output = write_report(tmp_path / "out", hung, "--n", 2, "--steps", 1)
    assert re.search(r"^largest von Mises stress +\S+ MPa +at \(.*\), t = 1 s$", output, re.M)
    assert re.search(r"^largest displacement +\S+ mm ", output, re.M)
    assert re.search(r"largest von Mises stress \S+ MPa at", Reader(page).text)
    again = vx.read_history(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["units"] == again.units == units
    assert "length mm, force N, time s" in again.summary()
    assert vx.plots.stressed_body(again).axes[0].get_xlabel() == "$x_1$ (mm)"
