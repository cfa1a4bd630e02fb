"""Arguments that once raised errors of Python's or NumPy's own."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import paper_scene, small

import vemcvx as vx

TIMES = np.linspace(0.0, 1.0, 3)


def run(**options):
    return vx.simulate(paper_scene(), small("squares", 3), TIMES, **options)


@pytest.mark.parametrize(
    ("act", "says"),
    [
        (lambda: run(store=np.array("last")), "store: found array('last', dtype='<U4'); there are 'all', 'last', an"),
        (lambda: run(store=np.array(1)), "store: found array(1); there are 'all', 'last', an integer"),
        (lambda: vx.meshes.squares(np.array("x")), "n must be a whole number"),
        (lambda: vx.meshes.cubes(np.array("x")), "n must be a whole number"),
        (lambda: vx.meshes.l_shape(np.array("x")), "n must be a whole number"),
        (lambda: small("squares", 2).to(np.ones(2)), "a mesh goes to 'meshio', 'skfem', 'pyvista'; got array"),
        (lambda: run(progress=lambda: 1), "wanted a function of (step, steps), but too many positional arguments."),
        (lambda: run(progress=lambda step: 1), "wanted a function of (step, steps), but too many positional"),
        (
            lambda: vx.adapt(paper_scene(), small("squares", 2), TIMES, target=0.5, progress=lambda: 1),
            "wanted a function of each Pass, but too many positional arguments.",
        ),
    ],
)
def test_a_sentence_says_what_was_found(act, says):
    with pytest.raises(vx.VemcvxError, match=re.escape(says)):
        act()


def test_progress_may_take_what_it_likes_besides():
    told = []
    run(progress=lambda step, steps, *, width=3: told.append((step, steps)))
    run(progress=lambda *both: told.append(both))
    assert told == 2 * [(1, 2), (2, 2)]


@pytest.mark.parametrize("wrong", [np.inf, -np.inf, np.nan])
def test_fields_that_are_not_finite_are_not_written(tmp_path, wrong):
    history = run()
    displacement = history.displacement.copy()
    displacement[1, 3, 0] = wrong
    with pytest.raises(vx.HistoryError, match="write: the displacement of node 3 in step 1 is .*; only finite fields"):
        replace(history, displacement=displacement).write(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_energies_that_overflow_are_written(tmp_path):
    history = run()
    replace(history, displacement=1e200 * history.displacement).write(tmp_path)
    assert vx.read_history(tmp_path).displacement.max() > 1e190


@pytest.mark.parametrize("wrong", [10**6, 16, -2, -5])
def test_partners_that_are_no_nodes_are_refused(tmp_path, wrong):
    run().write(tmp_path)
    with np.load(tmp_path / "history.npz") as file:
        arrays = dict(file)
    arrays["contact.partners"][0] = wrong
    np.savez(tmp_path / "history.npz", **arrays)
    with pytest.raises(vx.HistoryError, match=f"found contact.partners from .*{wrong}"):
        vx.read_history(tmp_path)


@pytest.mark.parametrize("part", ["indices", "indptr"])
@pytest.mark.parametrize("wrong", [10**6, -1, -(2**31)])
@pytest.mark.parametrize("place", [2, -1])
def test_sparse_matrices_that_lead_out_of_themselves_are_refused(part, wrong, place):
    """SciPy would read and write there, and end the process."""
    bad, good = sp.csr_matrix(2 * np.eye(4)), sp.csr_matrix(2 * np.eye(4))
    getattr(bad, part)[place] = wrong
    for act in (lambda: vx.System(bad, lambda t: np.ones(4)), lambda: vx.Norms(bad, 1.0), lambda: vx.Limits(bad, 1.0)):
        with pytest.raises(vx.SceneError, match="found a sparse matrix that leads out of itself"):
            act()
    vx.System(good, lambda t: np.ones(4))
