"""The table of hard cases: every case has the required behaviour, and no true error exceeds its certified error."""

from __future__ import annotations

import re

import numpy as np
import pytest

import hard_cases
import vemcvx as vx
from hard.case import Case, Setting, run
from hard.ground import block

IDS = [f"{subject}: {case.name}" for subject, case in hard_cases.CASES]
# Each slow case has a smaller variant.
SLOW = {
    "time and load: thin strip, L/H = 50: pushed, released, pushed",
    "time and load: ten cycles",
    "cells: a 500-gon among triangles",
    "cells: 20 flat angles an edge",
    "material: nu = 0.4999, polygons, full slip",
    "material: nu = 0.49999999, polygons, full slip",
}
CASES = [
    pytest.param(case, id=name, marks=pytest.mark.slow if name in SLOW else ())
    for name, (_, case) in zip(IDS, hard_cases.CASES, strict=True)
]


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")  # the table records warnings itself
@pytest.mark.parametrize("case", CASES)
def test_a_hard_case_has_the_required_behaviour(case):
    findings = run(case)
    assert [finding.complaint for finding in findings if finding.complaint] == []
    assert {finding.solver for finding in findings} == {solver.name for solver in case.solvers}


def test_names_of_cases_are_unique_and_every_subject_has_cases():
    assert set(IDS) >= SLOW
    assert len(set(IDS)) == len(IDS)
    assert {subject for subject, _ in hard_cases.CASES} == set(hard_cases.SUBJECTS)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_the_table_reports_every_kind_of_fault():
    mesh, times = vx.meshes.squares(4), np.linspace(0, 0.5, 3)
    zero = np.zeros((3, mesh.n_nodes, 2))

    def setting(exact=None):
        return lambda: Setting(block(), mesh, times, exact)

    newton = (vx.Newton(),)
    misspelt = Case("otherwise", lambda: Setting(block(clamp="no"), mesh, times), "refuse with an error", "floats")
    for case, complaint in (
        (Case("refused", setting(), must="refuse with an error", solvers=newton), "must refuse with an error"),
        (misspelt, "does not say 'floats'"),
        (Case("wrong reference", setting(zero), solvers=newton), "true error .* above certificate"),
        (Case("claim", setting(), holds=lambda setting, history: "it does not", solvers=newton), "it does not"),
    ):
        complaints = [finding.complaint for finding in run(case)]
        assert all(complaints)
        assert re.search(complaint, complaints[0])
