"""Errors and their observed orders, run by run, as Markdown, CSV and LaTeX."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, brief
from vemcvx.errors import HistoryError
from vemcvx.estimate.measures.convergence_orders import checked
from vemcvx.owned_files import path_of
from vemcvx.tables import csv_text, html, latex, markdown


@dataclass(frozen=True, eq=False, repr=False)
class ConvergenceTable:
    """Errors and their observed orders, size by size; prompts show it as Markdown, notebooks as a table.

    Attributes
    ----------
    name : str
        What the sizes are called.
    sizes : (m,) array
    errors, orders : dict of str to (m,) array
        By names. An order stands beside the finer of two runs, so the first is NaN.
    """

    name: str
    sizes: Floats
    errors: dict[str, Floats]
    orders: dict[str, Floats]

    def markdown(self) -> str:
        """As a table of Markdown."""
        return markdown(self._heads, self._words(lambda value: f"{value:#.4g}"))

    def latex(self) -> str:
        """As a tabular of LaTeX that needs no package; what stands between dollar signs in names is a formula."""
        return latex(self._heads, self._words(_in_latex))

    def csv(self) -> str:
        """As comma-separated values, with all digits and names of their own; what is missing is empty."""
        columns = [self.sizes, *(part[name] for name in self.errors for part in (self.errors, self.orders))]
        rows = zip(*(column.tolist() for column in columns), strict=True)
        heads = [self.name, *(head for name in self.errors for head in (name, f"order of {name}"))]
        return csv_text(heads, [["" if np.isnan(value) else value for value in row] for row in rows])

    def write(self, path: str | Path) -> Path:
        """Write it as .md, .csv or .tex, as the path ends.

        Raises
        ------
        HistoryError
            The path ends in something else, or cannot be written.
        """
        path = path_of(path, "ConvergenceTable.write")
        forms = {".md": self.markdown, ".csv": self.csv, ".tex": self.latex}
        if path.suffix not in forms:
            raise HistoryError(f"{path}: a table of convergence is written as {', '.join(forms)}.")
        try:
            path.write_text(forms[path.suffix](), encoding="utf-8")
        except OSError as error:
            raise HistoryError(f"{path}: cannot be written: {error}.") from error
        return path

    def __repr__(self) -> str:
        return self.markdown().rstrip()

    def _repr_html_(self) -> str:
        return html(self._heads, self._words(lambda value: f"{value:#.4g}"))

    @property
    def _heads(self) -> list[str]:
        return [self.name, *(head for name in self.errors for head in (name, "order"))]

    def _words(self, in_words: Callable[[float], str]) -> list[list[str]]:
        """The cells, row by row; what is missing is empty."""
        rows = []
        for row, size in enumerate(self.sizes):
            words = [_fraction(size)]
            for name, errors in self.errors.items():
                error, order = errors[row], self.orders[name][row]
                words += ["" if np.isnan(error) else in_words(error), "" if np.isnan(order) else f"{order:.2f}"]
            rows.append(words)
        return rows


def convergence_table(h: ArrayLike, errors: ArrayLike | Mapping[str, ArrayLike], name: str = "h") -> ConvergenceTable:
    """Errors in a mesh size or a step with their observed orders, to be read or written as Markdown, CSV or LaTeX.

    Parameters
    ----------
    h : (m,) sequence of positive numbers, no two neighbours alike
        Mesh sizes or steps; those that are one over a whole number are written so, but for CSV.
    errors : (m,) sequence of positive numbers, or mapping of names to such
        A column each, NaN where there is none, with a column of orders.
    name : str
        What the sizes are called.

    Raises
    ------
    HistoryError
        There are fewer than two runs, the lengths differ, a number is not positive, or a name is none.
    """
    given = errors if isinstance(errors, Mapping) else {"error": errors}
    for word in (name, *given):
        if not isinstance(word, str):
            raise HistoryError(f"convergence_table: found the name {brief(word)}; wanted words.")
    if not given:
        raise HistoryError("convergence_table: found no errors; give a sequence, or a mapping of names to sequences.")
    columns = {word: checked(h, values, f"convergence_table: {word}", missing=True) for word, values in given.items()}
    sizes = next(iter(columns.values()))[0]
    values = {word: column for word, (_, column) in columns.items()}
    rates = {word: np.diff(np.log(column)) / np.diff(np.log(sizes)) for word, column in values.items()}
    return ConvergenceTable(name, sizes, values, {word: np.append(np.nan, rate) for word, rate in rates.items()})


def _fraction(size: float) -> str:
    """A size in words: 1/64 where it is that, to rounding."""
    parts = round(1.0 / size) if size > 1e-9 else 0
    return f"1/{parts}" if parts > 1 and abs(parts * size - 1.0) < 1e-12 else f"{size:.4g}"


def _in_latex(value: float) -> str:
    """A number; powers of ten as they are printed."""
    digits, _, power = f"{value:#.4g}".partition("e")
    return rf"${digits}\cdot10^{{{int(power)}}}$" if power else digits
