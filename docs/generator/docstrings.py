"""Docstrings for Sphinx: what they mean by `|`, by names that end in `_`, and by names that have no page."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

from docutils import nodes

import vemcvx
from generator.reference import DESCRIBED, MODULES, SHORT

LITERAL = re.compile(r"``.*?``|:\w+(?::\w+)?:`[^`]+`|`[^`]+`")
"""What is literal, or a role, on one line."""
ROLE = re.compile(r":(?:py:)?(\w+):`~?\.?([\w.]+)`")


def _members() -> set[str]:
    classes = {full: kind for full, kind in DESCRIBED.items() if isinstance(kind, type)}
    # Fields of dataclasses stand in the entry of their class, and have none of their own.
    fields = {full: getattr(kind, "__dataclass_fields__", ()) for full, kind in classes.items()}
    named = ((full, member) for full, kind in classes.items() for member in dir(kind) if not member.startswith("_"))
    return {f"{full}.{member}" for full, member in named if member not in fields[full]}


KNOWN = {*DESCRIBED, *MODULES, *_members()}


def prepared(app: object, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Rewrite the lines of a docstring, in place (Sphinx's event autodoc-process-docstring)."""
    if what == "data":
        lines[:] = [_said_of(name.rpartition(".")[2]), ""]
    if what == "module":
        del lines[0]  # the heading
    # Every literal is matched, so that what stands between two of them is none; one that has a line's end is one line.
    literal = r"(?<!`)(`+)(?!`)(?:[^`\n]|\n(?!\s*\n))+\1(?!`)"
    text = re.sub(literal, lambda one: re.sub(r"\s*\n\s*", " ", one.group()), "\n".join(lines))
    kinds = "|".join(name for name in SHORT if name[0].isupper())
    text = re.sub(rf"^(list of )?({kinds})$", r"\1`\2`", text, flags=re.MULTILINE)  # what is raised, or returned
    lines[:] = [_typed(line) if formula else _line(line, _escaped) for line, formula in _marked(text)]


def _typed(line: str) -> str:
    """A line that is shown as it is typed, without roles: what stands to the right of one stays in its column."""
    return ROLE.sub(lambda role: role.group(2).ljust(len(role.group())), line).rstrip()


def _marked(text: str) -> Iterator[tuple[str, bool]]:
    """The lines of a docstring, and whether they are formulas: indented below an empty line, in no section's list.

    Formulas are given the mark of a literal block before them.
    """
    listed = within = False
    language, before = "text", ""
    following = [*text.split("\n")[1:], ""]
    for line, under in zip(text.split("\n"), following, strict=True):
        if re.fullmatch(r"-{3,}", under):
            listed = line not in ("Notes", "Examples")
        formula = not listed and line.startswith("    ") and (within or not before)
        before = line
        if line == "::":
            language = "python"
            continue
        if formula and not within:
            kind = "   :class: formula" if language == "text" else ""
            yield from ((mark, True) for mark in ("", f".. code-block:: {language}", kind, ""))
            language = "text"
        elif within and line and not formula:
            yield "", True
        within = formula or (within and not line)
        yield line, formula


@cache
def _said_of_all() -> dict[str, str]:
    """What stands below constants of the package, by their names."""
    said = {}
    for path in Path(vemcvx.__file__).parent.rglob("*.py"):
        body = ast.parse(path.read_text(encoding="utf-8")).body
        for node, below in pairwise(body):
            if isinstance(node, ast.Assign) and isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
                said |= {target.id: str(below.value.value) for target in node.targets if isinstance(target, ast.Name)}
    return said


def _said_of(name: str) -> str:
    return " ".join(_said_of_all().get(name, "").split())


def _line(line: str, plain: Callable[[str], str]) -> str:
    done, at = "", 0
    for literal in LITERAL.finditer(line):
        done += plain(line[at : literal.start()]) + _reference(literal.group())
        at = literal.end()
    return done + plain(line[at:])


def _escaped(words: str) -> str:
    """Bars are absolute values, never substitutions; a name that ends in _ is no target; `**style` is no emphasis."""
    words = re.sub(r"(?<!\\)\|", r"\|", words)
    words = re.sub(r"(?<![\w*])\*\*(?=\w+\b(?!\*))", r"\*\*", words)
    return re.sub(r"(\w)_(?!\w)", r"\1\\_", words)


def _reference(literal: str) -> str:
    """A role whose object has a page, or a name within backquotes that is public: a link. All else is literal."""
    role = ROLE.fullmatch(literal)
    if role:
        name = role.group(2)
        last = name.rpartition(".")[2] if role.group(1) in ("class", "func") else name.removeprefix("vemcvx.")
        candidates = name, SHORT.get(last), f"vemcvx.{name}"
        full = next((one for one in candidates if one in KNOWN), None)
        return f":py:obj:`{name} <{full}>`" if full else f"``{name}``"
    words = literal.strip("`")
    first, _, member = words.partition(".")
    if not literal.startswith(("``", ":")) and first in SHORT:
        own = f"{SHORT[first]}.{member}"
        return f":py:obj:`{words} <{own if own in KNOWN else SHORT[first]}>`"
    return literal if literal.startswith((":", "``")) else f"``{words}``"


def public_bases(app: object, name: str, thing: object, options: object, bases: list[type]) -> None:
    """Of the bases of a class name those that have a page (autodoc-process-bases)."""
    described = {id(one) for one in DESCRIBED.values()}
    bases[:] = [base for base in bases if id(base) in described] or [object]


def pictures_in_words(app: object, tree: nodes.document) -> None:
    """Give pictures that cells show the words that their figures say of themselves (doctree-read)."""
    for bundle in tree.findall(nodes.container):
        if bundle.get("nb_element") != "mime_bundle":
            continue
        plain = [child for child in bundle.children if child.get("mime_type") == "text/plain"]
        words = [" ".join(child.astext().split()) for child in plain]
        for image in bundle.findall(nodes.image):
            image.setdefault("alt", *words)
