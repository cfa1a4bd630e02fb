"""Tables of errors and observed orders, as Markdown, CSV and HTML."""

from __future__ import annotations

import csv
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import vemcvx as vx

H = 1 / np.array([4, 8, 16, 32])
SECOND = 0.5 * H**2
GAPPED = np.array([1e-2, np.nan, 1e-5, 1e-6])


@pytest.fixture
def table():
    return vx.measures.convergence_table(H, {"50 % of $h^2$": SECOND, "gap_ped|": GAPPED}, "h = k")


def test_orders_follow_from_successive_errors(table):
    assert table.orders["50 % of $h^2$"][1:] == pytest.approx([2.0, 2.0, 2.0], rel=1e-14)
    # An order needs two successive errors.
    assert np.isnan(table.orders["gap_ped|"][:3]).all()
    assert table.orders["gap_ped|"][3] == pytest.approx(np.log2(10.0), rel=1e-14)
    rough = vx.measures.convergence_table([0.3, 0.1, 0.07], [1.0, 0.2, 0.19])
    assert rough.orders["error"][1:] == pytest.approx(vx.measures.orders([0.3, 0.1, 0.07], [1.0, 0.2, 0.19]).successive)


def test_markdown_and_html_have_four_digits_and_orders(table):
    heads, rule, *rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in table.markdown().splitlines()]
    assert [head.strip() for head in heads] == ["h = k", "50 % of $h^2$", "order", r"gap_ped\|", "order"]
    assert {cell.strip() for cell in rule} == {"---:"}
    cells = [[cell.strip() for cell in row] for row in rows]
    assert cells[0] == ["1/4", "0.03125", "", "0.01000", ""]
    assert cells[1] == ["1/8", "0.007812", "2.00", "", ""]
    assert cells[3] == ["1/32", "0.0004883", "2.00", "1.000e-06", "3.32"]
    assert repr(table) == table.markdown().rstrip()
    shown = ET.fromstring(table._repr_html_())
    assert [cell.text for cell in shown[1][0]] == ["1/4", "0.03125", None, "0.01000", None]


def test_csv_has_all_digits_and_unique_names(table):
    rows = list(csv.DictReader(table.csv().splitlines()))
    assert [float(row["h = k"]) for row in rows] == H.tolist()
    assert [float(row["50 % of $h^2$"]) for row in rows] == SECOND.tolist()
    assert [float(row["gap_ped|"] or "nan") for row in rows] == pytest.approx(GAPPED, rel=0, nan_ok=True)
    orders = table.orders["50 % of $h^2$"]
    assert [float(row["order of 50 % of $h^2$"] or "nan") for row in rows] == pytest.approx(orders, rel=0, nan_ok=True)


def test_sizes_other_than_unit_fractions_are_decimal_numbers():
    cells = vx.measures.convergence_table([1.0, np.sqrt(2) / 8, 1e-300], [1.0, 0.5, 0.1], "k").markdown().splitlines()
    assert [line.split("|")[1].strip() for line in cells[2:]] == ["1", "0.1768", "1e-300"]
