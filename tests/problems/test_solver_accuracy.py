"""True errors of solvers are within certified bounds, and the table marks a bound that is broken."""

import sys
from dataclasses import replace

import pytest

import solver_accuracy as study

pytestmark = pytest.mark.arithmetic


@pytest.mark.long
def test_no_true_error_exceeds_its_certificate():
    rows = study.sweep(16, accuracies=(1e-2, 1e-6, 1e-10), repeats=1)
    assert [row for row in rows if not row.kept] == []
    assert {(row.step, row.form) for row in rows} == {(step, form) for step in study.STEPS for form in study.FORMS}
    # Some bounds are less than twice the true error, and some answers are far from the solution.
    assert max(row.true / row.certified for row in rows if row.certified > 1e-9) > 0.5
    assert max(row.true for row in rows) > 1e-5  # Clarabel is less accurate for degenerate terms
    assert max(row.reference for row in rows) < 1e-12
    assert all(row.true < 1e-12 for row in rows if row.solver == "Newton")


def test_one_active_set_step_corrects_clarabel_where_terms_are_degenerate():
    exact = study.reference("return", "condensed", 16)
    plain, polished = (
        study.measure(exact, name, study.solvers()[name](accuracy=1e-10), 1)
        for name in ("Clarabel", "Clarabel, polished")
    )
    assert [plain.missed, polished.missed] == [True, False]
    assert polished.true < 1e-12 < plain.true
    false = replace(plain, certified=0.1 * plain.true)
    assert "WRONG: true error above bound" in study.format_rows([false])


@pytest.mark.slow
def test_the_command_writes_a_table_and_a_picture(tmp_path, monkeypatch, capsys):
    arguments = ["--n", "16", "--repeats", "1", "--picture", tmp_path / "a.png", "--table", tmp_path / "a.csv"]
    monkeypatch.setattr(sys, "argv", ["solver_accuracy.py", *map(str, arguments)])
    assert study.main() == 0
    assert ", 0 farther from u* than their certificates allow" in capsys.readouterr().out
    assert (tmp_path / "a.csv").read_text().count("\n") > 50
    assert (tmp_path / "a.png").stat().st_size > 20_000
