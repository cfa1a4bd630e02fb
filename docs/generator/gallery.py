"""The gallery: a page for every problem of `problems`, from its docstring, its picture, its code and its tests."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from textwrap import dedent

from generator.formulas import tex
from generator.live import SCENES
from generator.reference import SHORT

ROOT = Path(__file__).resolve().parents[2]
PROBLEMS = ROOT / "problems"
NO_PROBLEMS = "gallery", "problem_pictures", "live_page"
"""Files that others draw with; the live page has a page of its own."""
GROUPS = {
    "Friction": "feng_han_huang frictional_hysteresis circular_hysteresis shear_lag block_on_incline janssen_silo "
    "strip_on_a_belt pressed_then_sheared pretensioned_tendon thermal_expansion_blocked_by_friction kelvin_voigt_creep "
    "slip_weakening manufactured_start_and_stop",
    "Contact": "hertz_contact cattaneo_mindlin rough_layer plate_on_springs beam_on_a_stop liner_in_housing "
    "block_between_dies bonded_pad",
    "Several bodies": "two_blocks_in_series pack_of_blocks press_fit lap_joint hertz_two_cylinders bolted_joint "
    "brake_pad_on_disc cohesive_interface rigid_punch joint_diagram pressurised_crack fault_slip",
    "In space": "block_in_space spherical_indenter hertz_two_balls tubes_shrunk_on cone_clutch lug_and_pin twisted_pad "
    "ball_in_socket dovetail skew_joint bolted_lap_joint bolted_flange block_dragged_along_a_curve",
    "Materials": "plate_with_hole circular_inclusion bimetallic_strip block_with_grain",
    "Accuracy": "guaranteed_bounds manufactured_full_slip missed_reversal l_shaped_bracket bracket_in_space "
    "adaptive_meshes effectivity stabilisation_spectrum stabilisations_of_ones_own midpoint_rule solver_accuracy "
    "hard_cases highs_optimal_at_zero paper_figures",
    "The same programs elsewhere": "spring_slider_chain elastoplastic_truss elastoplastic_block membrane_with_friction",
}
COMMAND = re.compile(r"^ {4}((?:vemcvx|python) .*)$", re.MULTILINE)
PICTURES = {"paper_figures": tuple(f"paper_figure_{name}" for name in ("1", "2_unit", "2_shear", "3", "4"))}


@dataclass(frozen=True)
class Problem:
    """A problem file and what it says of itself."""

    name: str

    @property
    def path(self) -> Path:
        """The file."""
        return PROBLEMS / f"{self.name}.py"

    @property
    def tree(self) -> ast.Module:
        """Its syntax."""
        return ast.parse(self.path.read_text(encoding="utf-8"))

    @property
    def begins(self) -> int:
        """The line at which its code begins, below its docstring."""
        return self.tree.body[1].lineno

    @property
    def title(self) -> str:
        """The first line of its docstring, without the full stop."""
        return self._said[0].removesuffix(".")

    @property
    def _said(self) -> tuple[str, str]:
        first, _, rest = (ast.get_docstring(self.tree) or "").partition("\n")
        return first, rest.strip("\n")

    @property
    def statement(self) -> str:
        """Its docstring below the first line, without the commands."""
        return COMMAND.sub("", self._said[1]).strip("\n")

    @property
    def command(self) -> str:
        """The command of its docstring, else that of its small setting."""
        given = COMMAND.findall(self._said[1])
        return given[0] if given else f"python problems/{self.name}.py"

    @property
    def pictures(self) -> list[str]:
        """Names of its pictures."""
        names = PICTURES.get(self.name, (self.name,))
        return [name for name in names if (PROBLEMS / "pictures" / f"{name}.png").is_file()]

    @property
    def uses(self) -> list[str]:
        """Public names that it takes from `vx`, in the order of the file, with their pages."""
        attributes = [node for node in ast.walk(self.tree) if isinstance(node, ast.Attribute)]
        taken = [node.attr for node in sorted(attributes, key=lambda node: (node.lineno, node.col_offset))]
        known = [name for name in dict.fromkeys(taken) if name in SHORT and name[0].isupper()]
        return [f"{{py:obj}}`{name} <{SHORT[name]}>`" for name in known]


def names() -> list[str]:
    """Names of all problems there are."""
    return [path.stem for path in sorted(PROBLEMS.glob("*.py")) if path.stem not in NO_PROBLEMS]


@cache
def tests() -> dict[str, list[str]]:
    """Of every problem the tests that use it, a line each: those of problems, and others that say what they are."""
    found: dict[str, list[str]] = {}
    known = re.compile("|".join(names()))
    for path in sorted((ROOT / "tests").glob("*/test_*.py")):
        text = path.read_text(encoding="utf-8")
        # Tests of texts and of commands are about no problem.
        named = path.parent.name not in ("whole", "cli") and known.search(text)
        for name, test in _uses(ast.parse(text)) if named else ():
            said = (ast.get_docstring(test) or "").partition("\n\n")[0].replace("\n", " ")
            of = f"::{test.name}" if isinstance(test, ast.FunctionDef) else ""
            if said or path.parent.name == "problems":
                found.setdefault(name, []).append(f"`{path.relative_to(ROOT)}{of}`" + (said and f": {markdown(said)}"))
    return found


def _uses(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef | ast.Module]]:
    """Problems and the tests of a module that name them, by an import or in words; or the module, if none does."""
    known, aliases = set(names()), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            aliases |= {one.asname or one.name: one.name for one in node.names if one.name in known}
        elif isinstance(node, ast.ImportFrom) and node.module in known:
            aliases |= {one.asname or one.name: node.module for one in node.names}
    left = set(aliases.values())
    for test in tree.body:
        if isinstance(test, ast.FunctionDef) and test.name.startswith("test"):
            inner = list(ast.walk(test))
            named = {aliases[node.id] for node in inner if isinstance(node, ast.Name) and node.id in aliases}
            words = {node.value for node in inner if isinstance(node, ast.Constant) and isinstance(node.value, str)}
            left -= named
            yield from ((name, test) for name in sorted(named | known & words))
    yield from ((name, tree) for name in sorted(left))


def markdown(text: str) -> str:
    """A docstring's text as MyST: characters of formulas are escaped, problems and public names are links."""
    blocks = re.split(r"((?:^ {4}.*\n?(?:\n(?= {4}))?)+)", text, flags=re.MULTILINE)
    return "".join(_formula(block) if n % 2 else _prose(block) for n, block in enumerate(blocks))


def _formula(block: str) -> str:
    made = tex(block)
    if made:
        return f"\n$$\n{made}\n$$\n\n"
    return f"\n```{{code-block}} text\n:class: formula\n\n{dedent(block).strip(chr(10))}\n```\n\n"


def _prose(text: str) -> str:
    text = re.sub(r":(?:mod|func):`([\w.]+)`", r"`\1`", text)
    parts = re.split(r"(`+[^`]+`+)", text)
    return "".join(_named(part) if n % 2 else _plain(part) for n, part in enumerate(parts))


def _named(literal: str) -> str:
    word = literal.strip("`").removeprefix("problems/").removesuffix(".py")
    if word in names():
        return f"[{Problem(word).title.partition(':')[0]}]({word}.md)"
    return literal


def _plain(text: str) -> str:
    """Emphasis stays; a star or bar of a formula is itself."""
    text = re.sub(r"(?<![\w*])(\*\*?)(\w[^*\n]*(?:\n[^*\n]+)?)\1(?![\w*])", r"\0\1\2\1\0".replace(r"\0", "\0"), text)
    parts = text.split("\0")
    return "".join(part if n % 2 else re.sub(r"([*<>|\[\]$])", r"\\\1", part) for n, part in enumerate(parts))


def _page(problem: Problem) -> str:
    pictures = "\n\n".join(f"![{_alt(problem, name)}](/pictures/{name}.png)" for name in problem.pictures)
    uses, compared = problem.uses, "\n".join(f"- {test}" for test in tests().get(problem.name, ()))
    parts = [
        f"# {problem.title}",
        pictures,
        markdown(problem.statement),
        f"## Run it\n\n```text\n{problem.command}\n```",
        f"It uses {', '.join(uses)}." if uses else "",
        _live(problem.name),
        f"## What the tests compare\n\n{compared}" if compared else "",
        f"## The file\n\n`problems/{problem.name}.py`, below its docstring, which is above:\n\n"
        f"```{{literalinclude}} /problems/{problem.name}.py\n:language: python\n:lines: {problem.begins}-\n```",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _live(name: str) -> str:
    """The page on which time moves, where there is one."""
    if name not in SCENES:
        return ""
    source = f"../_static/live/{name}.html"
    frame = f'<iframe class="live" loading="lazy" title="{name}, step by step" src="{source}"></iframe>'
    how = f"`vemcvx app {name} --html PAGE` wrote this page; on that of `vemcvx app {name}` all else has sliders, too."
    return f"## Step by step\n\n{frame}\n\n{how}"


def _short(problem: Problem) -> tuple[str, str]:
    """What stands before the colon of its title, and after it."""
    first, _, rest = problem.title.partition(": ")
    return first, rest


def _alt(problem: Problem, name: str) -> str:
    words = re.sub(r"([\[\]])", r"\\\1", problem.title)
    return f"Picture: {words}" if name == problem.name else f"Picture {name.rpartition('_')[2]}: {words}"


def write(folder: Path) -> None:
    """Write a page for every problem, and the page of all pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    sources = folder.parent / "problems"
    sources.mkdir(exist_ok=True)
    index = ["# Gallery", "Every problem file of `problems`, with its statement, its picture and its code."]
    for group, listed in GROUPS.items():
        cards = "\n".join(_card(Problem(name)) for name in listed.split())
        hidden = "\n".join(f"{_short(Problem(name))[0]} <{name}>" for name in listed.split())
        index += [f"## {group}", f"::::{{grid}} 1 2 3 3\n:gutter: 3\n\n{cards}\n::::"]
        index += [f"```{{toctree}}\n:hidden:\n\n{hidden}\n```"]
        for name in listed.split():
            (folder / f"{name}.md").write_text(_page(Problem(name)), encoding="utf-8")
            (sources / f"{name}.py").write_text(Problem(name).path.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "index.md").write_text("\n\n".join(index) + "\n", encoding="utf-8")


def _card(problem: Problem) -> str:
    picture = problem.pictures[:1]
    image = f":img-top: /pictures/{picture[0]}.png\n:img-alt: {_alt(problem, picture[0])}\n" if picture else ""
    first, rest = map(markdown, _short(problem))
    return f":::{{grid-item-card}} {first}\n:link: {problem.name}\n:link-type: doc\n{image}\n{rest}\n:::\n"
