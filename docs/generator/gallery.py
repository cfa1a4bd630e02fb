"""The gallery: a page for every problem, with docstring, picture, code and tests."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from generator.reference import SHORT

ROOT = Path(__file__).resolve().parents[2]
PROBLEMS = ROOT / "problems"
NO_PROBLEMS = "gallery", "live_page"  # files that are not problems
GROUP = re.compile(r"^```\{problems\}\n(.*?)```\n", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"^ {4}((?:vemcvx|python) .*)$", re.MULTILINE)
IMPORT = re.compile(r"^ *(?:import (\w+)(?: as (\w+))?|from (\w+) import (\w+))", re.MULTILINE)
LIVE = {"feng_han_huang": 30, "frictional_hysteresis": 20}  # live pages, and the step that each page shows first
PICTURES = {"paper_figures": tuple(f"paper_figure_{name}" for name in ("1", "2_unit", "2_shear", "3", "4"))}
STEP_BY_STEP = """## Step by step

<iframe class="live" loading="lazy" title="{0}, step by step" src="../_static/live/{0}.html"></iframe>

`vemcvx app {0} --html PAGE` wrote this page; `vemcvx app {0}` also has controls for scene, load and mesh."""


@dataclass(frozen=True)
class Problem:
    """A problem file and its docstring."""

    name: str

    @cached_property
    def text(self) -> str:
        """The text of the file."""
        return (PROBLEMS / f"{self.name}.py").read_text(encoding="utf-8")

    @cached_property
    def docstring(self) -> str:
        """The docstring of the file, in which names of problem files are links."""
        text = re.sub(r":(?:mod|func):(?=`)", "", ast.get_docstring(ast.parse(self.text)) or "")
        return re.sub(r"`(?:problems/)?(\w+)(?:\.py)?`", _link, text)

    @property
    def title(self) -> str:
        """The first line of the docstring, without the full stop."""
        return self.docstring.partition("\n")[0].removesuffix(".")

    @property
    def statement(self) -> str:
        """The docstring below the first line, without the commands."""
        return COMMAND.sub("", self.docstring.partition("\n")[2]).strip("\n")

    @property
    def command(self) -> str:
        """The first command in the docstring; if there is none, the command that runs the file."""
        return (*COMMAND.findall(self.docstring), f"python problems/{self.name}.py")[0]

    @property
    def pictures(self) -> list[str]:
        """The names of the pictures that exist for this problem."""
        names = PICTURES.get(self.name, (self.name,))
        return [name for name in names if (PROBLEMS / "pictures" / f"{name}.png").is_file()]


@cache
def list_problems() -> list[str]:
    """Return the names of all problem files."""
    return [path.stem for path in sorted(PROBLEMS.glob("*.py")) if path.stem not in NO_PROBLEMS]


def _link(literal: re.Match[str]) -> str:
    name = literal[1]
    if name not in list_problems():
        return literal[0]
    title = Problem(name).text.partition('"""')[2].partition("\n")[0]
    return f"[{title.partition(': ')[0].removesuffix('.')}]({name}.md)"


@cache
def find_tests() -> dict[str, list[str]]:
    """Return the tests that use each problem, one string per test."""
    found = defaultdict(list)
    for path in sorted(ROOT.glob("tests/*/test_*.py")):
        text = path.read_text(encoding="utf-8")
        used = {one[2] or one[4] or one[1]: one[1] or one[3] for one in IMPORT.finditer(text)}
        words = {rf"\b{word}[.(]": name for word, name in used.items() if name in list_problems()}
        words |= {f'"{name}"': name for name in list_problems() if f'"{name}"' in text}
        for test in ast.parse(text).body if words and path.parent.name not in ("whole", "cli") else ():
            if isinstance(test, ast.FunctionDef) and test.name.startswith("test"):
                code = "\n".join(text.split("\n")[test.lineno - 1 : test.end_lineno])
                sentence = " ".join((ast.get_docstring(test) or "").partition("\n\n")[0].split())
                line = f"- `{path.relative_to(ROOT)}::{test.name}`{sentence and f': {sentence}'}"
                for name in dict.fromkeys(name for word, name in words.items() if re.search(word, code)):
                    found[name].append(line)
    return found


def _write_page(problem: Problem) -> str:
    pictures = [f"![{_describe(problem, name)}](/pictures/{name}.png)" for name in problem.pictures]
    begin = ast.parse(problem.text).body[1].lineno
    public = dict.fromkeys(name for name in re.findall(r"\bvx\.([A-Z]\w+)", problem.text) if name in SHORT)
    tests = "\n".join(find_tests().get(problem.name, ()))
    parts = [
        f"# {problem.title}",
        *pictures,
        problem.statement,
        f"## Run it\n\n```text\n{problem.command}\n```",
        "The file uses " + ", ".join(f"{{py:obj}}`{name} <{SHORT[name]}>`" for name in public) + "." if public else "",
        STEP_BY_STEP.format(problem.name) if problem.name in LIVE else "",
        tests and f"## What the tests compare\n\n{tests}",
        f"## The file\n\n`problems/{problem.name}.py`, below its docstring:\n\n"
        f"```{{literalinclude}} /problems/{problem.name}.py\n:language: python\n:lines: {begin}-\n```",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _describe(problem: Problem, name: str) -> str:
    words = re.sub(r"\$|([\[\]])", r"\\\1", problem.title)
    return f"Picture: {words}" if name == problem.name else f"Picture {name.rpartition('_')[2]}: {words}"


def _write_cards(group: re.Match[str]) -> str:
    """Return a grid of cards and a hidden table of contents."""
    cards, pages = [], []
    for problem in map(Problem, group[1].split()):
        first, _, rest = problem.title.partition(": ")
        shown = [(name, _describe(problem, name)) for name in problem.pictures[:1]]
        image = "".join(f":img-top: /pictures/{name}.png\n:img-alt: {words}\n" for name, words in shown)
        cards += [f":::{{grid-item-card}} {first}\n:link: {problem.name}\n:link-type: doc\n{image}\n{rest}\n:::\n"]
        pages += [f"{first} <{problem.name}>"]
    grid = "::::{grid} 1 2 3 3\n:gutter: 3\n\n" + "\n".join(cards) + "::::\n"
    return f"{grid}\n```{{toctree}}\n:hidden:\n\n" + "\n".join(pages) + "\n```\n"


def write(folder: Path) -> None:
    """Write the pages of all problems, and the index."""
    index = (folder / "index.md").read_text(encoding="utf-8")
    (folder.parent / "problems").mkdir(exist_ok=True)
    for name in " ".join(GROUP.findall(index)).split():
        (folder / f"{name}.md").write_text(_write_page(Problem(name)), encoding="utf-8")
        (folder.parent / "problems" / f"{name}.py").write_text(Problem(name).text, encoding="utf-8")
    (folder / "index.md").write_text(GROUP.sub(_write_cards, index), encoding="utf-8")
