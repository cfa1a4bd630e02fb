"""What prompts and notebooks show of a record: a title and a line for every field, instead of all its numbers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import Field, dataclass, fields
from html import escape
from textwrap import shorten
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import brief

Lines = Sequence[tuple[str, str]]
LINE = 100
"""Characters of what is no array."""
KINDS = {"b": "true or false", "i": "whole numbers", "f": ""}


@dataclass(frozen=True)
class Outline:
    """A title, and lines of names with what there is to say of them."""

    title: str
    lines: Lines

    def text(self) -> str:
        """In plain words, the names in a column."""
        width = max((len(name) for name, _ in self.lines), default=0)
        return "\n".join([self.title, *(f"    {name:<{width}}  {words}".rstrip() for name, words in self.lines)])

    def html(self) -> str:
        """The same as a table; a name that is empty goes on with the one before."""
        rows = "".join(
            f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(words)}</td></tr>'
            for name, words in self.lines
        )
        return f"<table><caption>{escape(self.title)}</caption>{rows}</table>"


class Outlined(ABC):
    """A record that shows its outline where its representation is asked for."""

    @abstractmethod
    def outline(self) -> Outline:
        """What to show."""

    def __repr__(self) -> str:
        return self.outline().text()

    def _repr_html_(self) -> str:
        return self.outline().html()


class ArrayRecord(Outlined):
    """A dataclass of arrays: of each field its shape, or its value where that is short."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def outline(self) -> Outline:
        """The fields in their order; those of arrays of arrays one by one."""
        lines: list[tuple[str, str]] = []
        for field in (field for field in fields(self) if field.repr):
            value = getattr(self, field.name)
            inner = value.outline().lines if isinstance(value, ArrayRecord) else [("", in_a_line(value))]
            lines += [(f"{field.name}.{name}".rstrip("."), words) for name, words in inner]
        return Outline(type(self).__name__, lines)


def in_a_line(value: object) -> str:
    """An array by its shape, anything else in at most a line."""
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, sp.csr_matrix):
        return f"{value.shape} sparse, {value.nnz} entries"
    if not isinstance(value, np.ndarray):
        return shorten(brief(value), LINE)
    kind = KINDS.get(value.dtype.kind, str(value.dtype))
    return f"{value.shape} {kind}".rstrip()
