"""Problem files and lessons that come with the package: listed, found by name, copied; and complete in the wheel."""

from __future__ import annotations

import ast
import json
import os
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


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path


@pytest.mark.long
def test_all_problem_files_are_listed_with_a_sentence():
    code, said = call("problems")
    assert code == 0
    assert set(gallery.problem_files()) == set(supplied.problem_files())
    for name, file in supplied.problem_files().items():
        assert f"\n{name} " in f"\n{said}"
        assert file.sentence[0].isupper()
        assert file.sentence[-1] in ".:?!"
    assert "hard_cases" not in said
    assert "A block pushed over a rough" in said
    assert max(map(len, said.split("\n\n")[0].splitlines())) <= 80


def test_a_sentence_ends_at_its_own_full_stop(tmp_path):
    file = tmp_path / "one.py"
    strip = "A strip (S. P. Timoshenko, 1925), heated by 0.5 degrees."
    for text, first in [(f'"""{strip}\nIt bends."""', strip), ('"""No stop"""', "No stop"), ("x = 1", "")]:
        file.write_text(text)
        assert supplied.Supplied(file).sentence == first


@pytest.mark.long
@pytest.mark.parametrize("command", ["run", "show"])
def test_a_problem_is_found_by_its_name(command):
    code, said = call(command, "feng_han_huang", "--n", "4", *(("--steps", "2") if command == "run" else ()))
    assert code == 0, said
    assert said.startswith("feng_han_huang: A block pushed over a rough obstacle")


def test_a_file_that_is_here_comes_first(tmp_path):
    (tmp_path / "feng_han_huang").write_text("")
    assert supplied.problem_path("feng_han_huang") == Path("feng_han_huang")
    # With a folder or a suffix it is a path.
    for path in ("./hertz_contact", "hertz_contact.py"):
        assert supplied.problem_path(path) == Path(path)


@pytest.mark.long
@pytest.mark.parametrize("name", ["feng_han_huangs", "hard_cases", "gallery"])
def test_a_name_that_is_no_problem_file_is_an_error(name):
    code, said = call("run", name)
    assert code == 2
    assert f"{name}: there is no such problem file here" in said
    assert "`vemcvx problems` lists" in said


def test_lessons_are_listed_and_copied_and_nothing_is_overwritten(tmp_path):
    code, said = call("lesson")
    assert code == 0
    assert " ".join(said.split()).startswith("1 one slider: a variational inequality by hand")
    code, said = call("lesson", "1")
    assert code == 0
    names = ["lesson_1_one_slider.py", "lesson_1_solutions.py"]
    assert said.split()[:2] == sorted(path.name for path in tmp_path.iterdir()) == names
    for name in names:
        assert (tmp_path / name).read_text() == (ROOT / "problems" / "lessons" / name).read_text()
    (tmp_path / names[0]).unlink()
    (tmp_path / names[1]).write_text("mine")
    code, said = call("lesson", "1")
    assert code == 2
    assert f"{names[1]} exists, and no file is overwritten" in said
    assert [path.name for path in tmp_path.iterdir()] == [names[1]]
    assert (tmp_path / names[1]).read_text() == "mine"


def test_lessons_are_copied_as_notebooks(tmp_path):
    """Cells have the source that they have in the file; the title is markdown, and what only draws is folded."""
    code, said = call("lesson", "3", "--notebook")
    assert code == 0
    names = ["lesson_3_solutions.ipynb", "lesson_3_virtual_elements.ipynb"]
    assert sorted(said.split()[:2]) == sorted(path.name for path in tmp_path.iterdir()) == names
    made = json.loads((tmp_path / names[1]).read_text(encoding="utf-8"))
    assert (made["nbformat"], made["nbformat_minor"]) == (4, 5)
    text = (ROOT / "problems" / "lessons" / "lesson_3_virtual_elements.py").read_text(encoding="utf-8")
    cells = made["cells"]
    assert len(cells) == len(re.findall("^# %%", text, re.MULTILINE))
    assert len({cell["id"] for cell in cells}) == len(cells)
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
    code, said = call("lesson", "3", "--notebook")
    assert code == 2
    assert "lesson_3_virtual_elements.ipynb exists, and no file is overwritten" in said


@pytest.mark.parametrize(
    ("words", "name"), [((), "lesson_1_one_slider.py"), (("--notebook",), "lesson_1_one_slider.ipynb")]
)
def test_for_homework_a_lesson_is_copied_without_its_solutions(tmp_path, words, name):
    code, said = call("lesson", "1", "--no-solutions", *words)
    assert code == 0
    assert [said.split()[0]] == [path.name for path in tmp_path.iterdir()] == [name]
    assert "lesson_1_solutions" not in (tmp_path / name).read_text(encoding="utf-8")
    assert "--no-solutions" in call("lesson", "--help")[1]


@pytest.mark.parametrize("option", ["--notebook", "--no-solutions"])
def test_a_copy_of_no_lesson_is_an_error(option):
    code, said = call("lesson", option)
    assert code == 2
    assert f"found {option} without a number; `vemcvx lesson` lists" in said


def test_a_lesson_that_does_not_exist_is_an_error():
    code, said = call("lesson", "99")
    assert code == 2
    assert "there is no lesson 99; there are 1, " in said


def test_a_package_without_them_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(supplied, "PACKAGE", tmp_path / "vemcvx")
    code, said = call("problems")
    assert code == 2
    assert "found no problem files" in said


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel, unpacked as an installer unpacks it."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as packed:
        packed.extractall(folder / "site")
    return folder / "site"


def files(folder, *suffixes):
    return {path.relative_to(folder) for path in folder.rglob("*") if path.suffix in suffixes and path.is_file()}


@pytest.mark.slow
def test_the_wheel_has_every_module_problem_and_lesson_and_no_picture(wheel):
    inside = wheel / "vemcvx" / "problems"
    assert files(inside, ".py", ".mps") == files(ROOT / "problems", ".py", ".mps")
    assert not files(inside, ".png")
    modules = {path for path in files(wheel / "vemcvx", ".py", ".typed") if path.parts[0] != "problems"}
    assert modules == files(ROOT / "vemcvx", ".py", ".typed")


@pytest.mark.slow
def test_the_wheel_works_in_an_empty_folder(wheel, tmp_path):
    def vemcvx_says(*words):
        environment = {**os.environ, "PYTHONPATH": str(wheel)}
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert vemcvx_says("-c", "import vemcvx; print(vemcvx.__file__)").startswith(str(wheel))
    assert str(wheel / "vemcvx" / "problems") in vemcvx_says("-m", "vemcvx", "problems").replace("\n", "")
    assert "2 steps" in vemcvx_says("-m", "vemcvx", "run", "feng_han_huang", "--n", "4", "--steps", "2")
    for lesson in vemcvx_says("-m", "vemcvx", "lesson", "1").split()[:2]:
        vemcvx_says(lesson)
