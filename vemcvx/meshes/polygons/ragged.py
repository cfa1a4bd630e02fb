"""Rows of different lengths laid end to end: row r is ``flat[offsets[r]:offsets[r + 1]]``."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Ints


def spans(starts: Ints, counts: Ints) -> Ints:
    """The numbers starts[0], starts[0] + 1, ... (counts[0] of them), then those from starts[1] and so on."""
    before = np.cumsum(counts) - counts
    return np.repeat(starts - before, counts) + np.arange(counts.sum())


def offsets_of(counts: Ints) -> Ints:
    """Where rows of these lengths begin, and where the last ends."""
    return np.concatenate([[0], np.cumsum(counts)])


def first_in_row(flags: Bools, offsets: Ints) -> Ints:
    """Place of the first True in each row, counted from the beginning of the row; 0 if there is none."""
    place = np.arange(len(flags)) - np.repeat(offsets[:-1], np.diff(offsets))
    none = len(flags)
    first = np.minimum.reduceat(np.where(flags, place, none), offsets[:-1])
    return np.where(first == none, 0, first)


def rotation(offsets: Ints, first: Ints) -> Ints:
    """Positions of all entries with every row turned so that it begins with its entry number ``first``."""
    counts = np.diff(offsets)
    begin, count = np.repeat(offsets[:-1], counts), np.repeat(counts, counts)
    turned: Ints = (np.arange(offsets[-1]) - begin + np.repeat(first, counts)) % count
    return begin + turned
