"""Docstrings as reStructuredText, with roles for formulas and links for names."""

from __future__ import annotations

import inspect
import re

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.ext.autosummary import Autosummary

from generator.reference import OBJECTS, SHORT

PIECE = re.compile(
    r"(?P<verbatim>``[^`]+``|::\n(?:\n+ +.*)+(?:\n(?: .*)?)*|^ *>>> (?:.*\n)+?(?=\s*(?:\n|\Z)))"
    r"|(?:^(?P<indent> *))?\$\$(?P<display>[^$]+)\$\$|\$(?P<formula>[^$]+)\$"
    r"|(?P<role>:(?:\w+:)+)?`[~.]*(?P<name>[^`]+)`"
    r"|(?P<mark>\||(?<= )\.(?= )|(?<=\w)_(?!\w)|(?<![\w*])\*\*(?=\w)(?!.*\w[.:]?\*\*))",
    re.MULTILINE,
)


def prepare(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Translate the lines of a docstring in place."""
    lines[:] = PIECE.sub(_translate, "\n".join(lines)).split("\n")


def _translate(piece: re.Match[str]) -> str:
    """Return a piece of a docstring as reStructuredText."""
    if piece["display"]:
        indent = piece["indent"] or ""
        rows = [f"{indent}   {row.strip()}" for row in piece["display"].strip().split("\n")]
        return "\n".join(["", f"{indent}.. math::", "", *rows, ""])
    if piece["formula"]:
        return f":math:`{' '.join(piece['formula'].split())}`"
    if piece["name"]:
        return _refer(" ".join(piece["name"].split()), bool(piece["role"]))
    return {".": "·", None: piece.group()}.get(piece["mark"], f"\\{piece['mark']}")


def _refer(words: str, is_role: bool) -> str:
    """Return a link to a public name or its member, or a literal."""
    first, _, member = words.removeprefix("vemcvx.").partition(".")
    target = words if words in OBJECTS else SHORT.get(first, SHORT.get(words.rpartition(".")[2] if is_role else ""))
    if target is None:
        return f"``{words}``"
    fields = getattr(OBJECTS[target], "__dataclass_fields__", ())  # fields are described in the entry of their class
    is_entry = member and hasattr(OBJECTS[target], member) and member not in fields
    return f":py:obj:`{words} <{target}{f'.{member}' if is_entry else ''}>`"


def keep_public_bases(app: Sphinx, name: str, thing: object, options: object, bases: list[type]) -> None:
    """Keep the base classes that have an entry in the reference."""
    bases[:] = [base for base in bases if any(base is one for one in OBJECTS.values())] or [object]


def describe_pictures(app: Sphinx, tree: nodes.document) -> None:
    """Describe each picture by the printed text of its notebook cell."""
    for bundle in tree.findall(nodes.container):
        if bundle.get("nb_element") == "mime_bundle":
            texts = [child.astext() for child in bundle.children if child.get("mime_type") == "text/plain"]
            for image in bundle.findall(nodes.image):
                image.setdefault("alt", *(" ".join(text.split()) for text in texts))


class Entries(Autosummary):
    """The directive `entries`: a table of names, and the entry of each name."""

    def run(self) -> list[nodes.Node]:
        """Return the table and the entries."""
        self.options["nosignatures"] = None
        bases = ", ".join({"Exception", "object", "tuple", *(name for name in SHORT if name[0].isupper())})
        lines, names = [], list(filter(None, self.content))
        self.content = [f"~{name}" for name in names]
        for name in names:
            is_class = inspect.isclass(OBJECTS[name])
            lines += [f".. auto{'class' if is_class else 'function'}:: {name}"]
            lines += ["   :members:", "   :show-inheritance:", f"   :inherited-members: {bases}"] * is_class
            lines += [""]
        return [*super().run(), *self.parse_text_to_nodes("\n".join(lines))]
