"""Problem files and lessons of the package are listed, found by name, copied, and contained in the wheel."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from called import call

import gallery
from vemcvx.cli import supplied

ROOT = Path(__file__).parents[2]
LESSONS = ROOT / "problems" / "lessons"


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path


def run(*words):
    code, printed = call(*words)
    assert code == 0, printed
    return printed


def refuse(*words):
    code, printed = call(*words)
    assert code == 2
    return " ".join(printed.split())


@pytest.mark.long
def test_all_problem_files_are_listed_with_a_sentence():
    printed = run("problems")
    assert set(gallery.problem_files()) == set(supplied.problem_files())
    for name, file in supplied.problem_files().items():
        assert f"\n{name} " in f"\n{printed}"
        assert file.sentence[0].isupper()
        assert file.sentence[-1] in ".:?!"
    assert "hard_cases" not in printed
    assert max(map(len, printed.split("\n\n")[0].splitlines())) <= 80


def test_a_sentence_does_not_end_at_the_stop_of_an_initial_or_a_number(tmp_path):
    file = tmp_path / "one.py"
    strip = "A strip (S. P. Timoshenko, 1925), heated by 0.5 degrees."
    for text, first in [(f'"""{strip}\nIt bends."""', strip), ('"""No stop"""', "No stop"), ("x = 1", "")]:
        file.write_text(text)
        assert supplied.Supplied(file).sentence == first


def test_a_local_file_precedes_a_problem_of_the_same_name(tmp_path):
    assert run("show", "feng_han_huang", "--n", "4").startswith("feng_han_huang: A block pushed over a rough obstacle")
    (tmp_path / "feng_han_huang").write_text("")
    assert supplied.problem_path("feng_han_huang") == Path("feng_han_huang")
    for path in ("./hertz_contact", "hertz_contact.py"):
        assert supplied.problem_path(path) == Path(path)


def test_a_lesson_is_copied_and_overwrites_nothing(tmp_path):
    assert run("lesson").split()[:4] == ["1", "one", "slider:", "a"]
    printed = run("lesson", "1")
    names = ["lesson_1_one_slider.py", "lesson_1_solutions.py"]
    assert printed.split()[:2] == sorted(path.name for path in tmp_path.iterdir()) == names
    for name in names:
        assert (tmp_path / name).read_text() == (LESSONS / name).read_text()
    (tmp_path / names[0]).unlink()
    (tmp_path / names[1]).write_text("mine")
    assert f"{names[1]} exists, and no file is overwritten" in refuse("lesson", "1")
    assert [path.name for path in tmp_path.iterdir()] == [names[1]]
    assert (tmp_path / names[1]).read_text() == "mine"


def test_a_lesson_is_copied_as_a_notebook_with_the_cells_of_its_file(tmp_path):
    """The title is a Markdown cell. Cells that only draw are folded."""
    printed = run("lesson", "3", "--notebook")
    names = ["lesson_3_solutions.ipynb", "lesson_3_virtual_elements.ipynb"]
    assert sorted(printed.split()[:2]) == sorted(path.name for path in tmp_path.iterdir()) == names
    made = json.loads((tmp_path / names[1]).read_text(encoding="utf-8"))
    assert (made["nbformat"], made["nbformat_minor"]) == (4, 5)
    text = (LESSONS / "lesson_3_virtual_elements.py").read_text(encoding="utf-8")
    cells = made["cells"]
    assert len(cells) == len({cell["id"] for cell in cells}) == len(re.findall("^# %%", text, re.MULTILINE))
    assert cells[0]["cell_type"] == "markdown"
    assert cells[0]["source"] == [ast.get_docstring(ast.parse(text))]
    for cell in cells[1:]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            ast.parse(source)
            assert source in text
            assert cell["metadata"] == ({"jupyter": {"source_hidden": True}} if "plt.subplots(" in source else {})
        else:
            assert source.replace("\n", "\n# ").replace("# \n", "#\n") in text


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The folder of the unpacked wheel."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as packed:
        packed.extractall(folder / "site")
    return folder / "site"


def list_files(folder, *suffixes):
    return {path.relative_to(folder) for path in folder.rglob("*") if path.suffix in suffixes and path.is_file()}


@pytest.mark.slow
def test_the_wheel_has_every_module_problem_and_lesson_and_no_picture(wheel):
    inside = wheel / "vemcvx" / "problems"
    assert list_files(inside, ".py", ".mps") == list_files(ROOT / "problems", ".py", ".mps")
    assert not list_files(inside, ".png")
    modules = {path for path in list_files(wheel / "vemcvx", ".py", ".typed") if path.parts[0] != "problems"}
    assert modules == list_files(ROOT / "vemcvx", ".py", ".typed")
