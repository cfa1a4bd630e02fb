"""Steps with few unknowns use one BLAS thread, and the number of threads is restored afterwards."""

from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from scenes import paper_scene, small
from threadpoolctl import ThreadpoolController, threadpool_limits

import vemcvx as vx
from vemcvx.linear.default import one_thread


def list_threads():
    """Return the thread counts of all BLAS libraries."""
    found = [library for library in ThreadpoolController().info() if library["user_api"] == "blas"]
    return {one["num_threads"] for one in found if Path(one["filepath"]).parent.name in ("numpy.libs", "scipy.libs")}


@pytest.fixture(autouse=True)
def two_threads():
    with threadpool_limits(limits=2, user_api="blas"):
        if list_threads() != {2}:
            pytest.skip("NumPy and SciPy have no BLAS of their own, or one with a single thread")
        yield


def test_steps_use_one_thread_and_restore_the_number_of_threads():
    scene, mesh, seen = paper_scene(), small("squares", 6), []
    vx.simulate(scene, mesh, np.linspace(0, 1, 4), progress=lambda *_: seen.append(list_threads()))
    assert seen == [{1}] * 3
    assert list_threads() == {2}
    with pytest.raises(ZeroDivisionError):
        vx.simulate(scene, mesh, [0.0, 1.0], progress=lambda *_: 1 / 0)
    assert list_threads() == {2}


def test_threads_other_than_the_main_thread_do_not_change_the_number_of_threads():
    seen = []

    def enter():
        with one_thread(10):
            seen.append(list_threads())

    thread = Thread(target=enter)
    thread.start()
    thread.join()
    assert seen == [{2}]
