"""The cost of algebraic accuracy: true errors are within certified bounds, and the table shows a broken bound."""

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
    # The test is strict: some bounds are less than twice the true error, and some answers are far from the solution.
    assert max(row.true / row.certified for row in rows if row.certified > 1e-9) > 0.5
    assert max(row.true for row in rows) > 1e-5  # errors of Clarabel where terms are degenerate
    assert max(row.reference for row in rows) < 1e-12
    assert all(row.true < 1e-12 for row in rows if row.solver == "Newton")


@pytest.fixture(scope="module")
def returned():
    """Return rows of Clarabel, without and with an active-set step, on a condensed program with degenerate terms."""
    exact = study.reference("return", "condensed", 16)
    return [
        study.measure(exact, name, study.solvers()[name](accuracy=1e-10), 1)
        for name in ("Clarabel", "Clarabel, polished")
    ]


def test_one_active_set_step_corrects_clarabel_where_terms_are_degenerate(returned):
    plain, polished = returned
    assert [plain.missed, polished.missed] == [True, False]
    assert polished.true < 1e-12 < plain.true


def test_a_broken_bound_is_printed_and_the_command_fails(returned, monkeypatch, capsys):
    worst = max(returned, key=lambda row: row.true)
    false = replace(worst, certified=0.1 * worst.true)
    assert "WRONG: true error above bound" in study.format_rows([false])
    monkeypatch.setattr(study, "run_loops", lambda: "")
    monkeypatch.setattr(sys, "argv", ["solver_accuracy.py"])
    for rows, code in (([worst], 0), ([worst, false], 1)):
        monkeypatch.setattr(study, "sweep", lambda *_, rows=rows, **__: rows)
        assert study.main() == code
        assert f"{len(rows)} answers, {code} farther" in capsys.readouterr().out


@pytest.mark.long
def test_the_chain_marches_through_degenerate_steps():
    """True errors of conic solvers are within their certificates, and polished answers reach rounding."""
    lines = {line[:20].strip(): line[20:].split() for line in study.run_loops(asked=(1e-6,)).splitlines()[1:]}
    assert set(lines) == set(study.OURS)
    for name in ("Clarabel", "OSQP"):
        certified, all_steps, true = map(float, lines[name][1:4])
        assert 1e-8 < true < all_steps
        assert certified < 1e-5
        assert float(lines[f"{name}, polished"][3]) < 1e-12


@pytest.mark.slow
def test_the_command_writes_a_table_and_a_picture(tmp_path, monkeypatch, capsys):
    arguments = ["--n", "16", "--repeats", "1", "--picture", tmp_path / "a.png", "--table", tmp_path / "a.csv"]
    monkeypatch.setattr(sys, "argv", ["solver_accuracy.py", *map(str, arguments)])
    assert study.main() == 0
    assert ", 0 farther from u* than their certificates allow" in capsys.readouterr().out
    assert (tmp_path / "a.csv").read_text().count("\n") > 50
    assert (tmp_path / "a.png").stat().st_size > 20_000
