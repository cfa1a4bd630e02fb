"""At a prompt and in a notebook, a result of any size fits on one screen."""

import xml.etree.ElementTree as ET
from functools import cache

import numpy as np
import pytest
from scenes import paper_scene

import vemcvx as vx
from vemcvx.base.table import Table

SCREEN = 30, 140
"""Lines and columns of a screen."""
NAMES = "history", "contact", "trajectory", "program", "certificate"
LONG = "budget", "bound", "whole", "of"
"""Results that take seconds to compute."""


@pytest.fixture(scope="module")
def shown():
    scene, mesh = paper_scene(), vx.meshes.squares(6)
    history = vx.simulate(scene, mesh, np.linspace(0.0, 1.0, 33))
    made = {
        "history": lambda: history,
        "contact": lambda: history.contact,
        "trajectory": lambda: history.trajectory,
        "program": lambda: history.program(7),
        "certificate": lambda: history.program(7).certificate,
        "budget": lambda: vx.error_budget(history),
        "bound": lambda: vx.error_bound(history, step=-1),
        "whole": lambda: vx.error_bound(history),
        "of": lambda: vx.error_bound(history, step=-1, of=vx.Traction((1.0, 0.0), on="left")),
    }
    return cache(lambda name: made[name]())


@pytest.mark.parametrize("name", [*NAMES, *(pytest.param(name, marks=pytest.mark.long) for name in LONG)])
def test_a_result_fits_a_screen(shown, name):
    lines = repr(shown(name)).splitlines()
    assert len(lines) <= SCREEN[0]
    assert max(map(len, lines)) <= SCREEN[1]
    table = ET.fromstring(shown(name)._repr_html_())
    assert table.tag == "table"
    assert len(table) <= SCREEN[0]


@pytest.mark.parametrize("width", [20, 60, 80])
def test_tables_keep_their_digits_on_any_terminal(monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    numbers, words = ["1.23456789e-05"] * 7, "words that are folded if there is no room for them"
    plain = Table(("a",) * 7, [numbers]).text().splitlines()[-1]
    assert plain.split() == numbers
    folded = Table(("a",) * 8, [[*numbers, words]]).text()
    assert folded.split() == ["a"] * 8 + numbers + words.split()
