"""Steps work with one BLAS thread, and what was before comes back, however they end."""

from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from scenes import paper_scene, small
from threadpoolctl import ThreadpoolController, threadpool_limits

import vemcvx as vx
from vemcvx.linear.default import one_thread


def threads():
    """Of the libraries of NumPy and SciPy; solvers that are imported later may bring their own."""
    found = [library for library in ThreadpoolController().info() if library["user_api"] == "blas"]
    return {one["num_threads"] for one in found if Path(one["filepath"]).parent.name in ("numpy.libs", "scipy.libs")}


@pytest.fixture(autouse=True)
def before():
    with threadpool_limits(limits=2, user_api="blas"):
        if threads() != {2}:
            pytest.skip("NumPy and SciPy have a BLAS of one thread, or none of their own")
        yield threads()


def test_steps_have_one_thread_and_the_process_has_its_own_again(before):
    seen = []
    vx.simulate(paper_scene(), small("squares", 6), np.linspace(0, 1, 4), progress=lambda *_: seen.append(threads()))
    assert seen == [{1}] * 3
    assert threads() == before


def test_a_run_that_ends_with_an_error_gives_them_back(before):
    with pytest.raises(ZeroDivisionError):
        vx.simulate(paper_scene(), small("squares", 6), [0.0, 1.0], progress=lambda *_: 1 / 0)
    assert threads() == before


def test_other_threads_leave_the_process_as_it_is(before):
    seen = []

    def beside():
        with one_thread(10):
            seen.append(threads())

    thread = Thread(target=beside)
    thread.start()
    thread.join()
    assert seen == [before]


def test_runs_within_runs_nest_and_large_matrices_keep_all_threads(before):
    with one_thread(10):
        with one_thread(10):
            assert threads() == {1}
        assert threads() == {1}
    assert threads() == before
    with one_thread(2_000):
        assert threads() == before
