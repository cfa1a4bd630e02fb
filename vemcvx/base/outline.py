"""Outlines of records as text and HTML."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import Field, dataclass, fields
from html import escape
from textwrap import shorten
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import brief

Lines = Sequence[tuple[str, str]]


def count_steps(steps: int) -> str:
    """Return "1 step", "2 steps" and so on."""
    return f"{steps} step{'s' * (steps != 1)}"


@dataclass(frozen=True)
class Outline:
    """A title and named lines of text."""

    title: str
    lines: Lines

    def text(self) -> str:
        """Return the outline as plain text."""
        width = max((len(name) for name, _ in self.lines), default=0)
        return "\n".join([self.title, *(f"    {name:<{width}}  {words}".rstrip() for name, words in self.lines)])

    def html(self) -> str:
        """Return the outline as an HTML table."""
        rows = "".join(
            f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(words)}</td></tr>'
            for name, words in self.lines
        )
        return f"<table><caption>{escape(self.title)}</caption>{rows}</table>"


class Outlined(ABC):
    """Base class of records that print as an outline."""

    @abstractmethod
    def outline(self) -> Outline:
        """Return the outline."""

    def __repr__(self) -> str:
        return self.outline().text()

    def _repr_html_(self) -> str:
        return self.outline().html()


class ArrayRecord(Outlined):
    """A dataclass whose outline shows the shape or value of each field."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def outline(self) -> Outline:
        """Return one line per field."""
        lines: list[tuple[str, str]] = []
        for field in (field for field in fields(self) if field.repr):
            value = getattr(self, field.name)
            inner = value.outline().lines if isinstance(value, ArrayRecord) else [("", in_a_line(value))]
            lines += [(f"{field.name}.{name}".rstrip("."), words) for name, words in inner]
        return Outline(type(self).__name__, lines)


def in_a_line(value: object) -> str:
    """Return a short text for a value, or the shape and type of an array."""
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, sp.csr_matrix):
        return f"{value.shape} sparse, {value.nnz} entries"
    if not isinstance(value, np.ndarray):
        return shorten(brief(value), 100)
    kind = {"b": "true or false", "i": "whole numbers", "f": ""}.get(value.dtype.kind, str(value.dtype))
    return f"{value.shape} {kind}".rstrip()


def coordinates(point: Iterable[float], digits: int = 4) -> str:
    """Return a point as text, such as "(0.3, 1.25)"."""
    return f"({', '.join(f'{x:.{digits}g}' for x in point)})"
