"""Several runs at once, in threads and in processes."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scenes import cyclic, paper_scene, small

import vemcvx as vx

TIMES = np.linspace(0.0, 1.0, 4)
ERRORS = (vx.NotCertified("missed", step=3, time=0.5, reached=1e-3, asked=1e-6, floor=1e-9), vx.SceneError("wrong"))


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_errors_survive_pickling(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert (str(again), vars(again)) == (str(error), vars(error))


def simulated(solver):
    return vx.simulate(paper_scene(cyclic), small("squares", 6), TIMES, solver=solver).displacement


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP()], ids=lambda solver: solver.name)
def test_runs_in_threads_do_not_affect_each_other(solver):
    alone = simulated(solver)
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(simulated, [solver] * 8))
    for displacement in together:
        np.testing.assert_array_equal(displacement, alone)
