"""Numbers in text, to the bit."""

from __future__ import annotations

from collections.abc import Iterator

import scipy.sparse as sp


def number(x: float) -> str:
    """The shortest words that read as this number."""
    return repr(float(x))


def triplets(rows: sp.csr_matrix) -> Iterator[tuple[int, int, float]]:
    """Row, column and value of the entries that are not zero, row by row."""
    rows.sort_indices()
    coo = rows.tocoo()
    for i, j, x in zip(coo.row.tolist(), coo.col.tolist(), coo.data.tolist(), strict=True):
        if x:
            yield i, j, x
