"""Interrupted runs keep completed steps, and can be resumed."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scenes import cyclic, paper_scene, small
from stopped import Stopped, stop_at

import vemcvx as vx

TIMES = np.linspace(0.0, 1.0, 25)
SERIES = ("displacement", "forces", "energy", "dissipated", "work", "certificate")


@pytest.mark.long
@pytest.mark.parametrize("store", ["all", 5])
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
def test_a_resumed_run_equals_an_uninterrupted_run(tmp_path, store, solver):
    scene, mesh = paper_scene(cyclic), small("voronoi", 5)
    options = {"solver": solver, "store": store}
    whole = vx.simulate(scene, mesh, TIMES, **options)
    with pytest.raises(Stopped):
        vx.simulate(scene, mesh, TIMES, stream=tmp_path, progress=stop_at(13), **options)
    steps = []
    resumed = vx.simulate(
        scene, mesh, TIMES, stream=tmp_path, resume=True, progress=lambda n, _: steps.append(n), **options
    )
    # Stored steps before the interruption are not computed again.
    assert steps[0] == {"all": 14, 5: 11}[store]
    for name in SERIES:
        one, two = getattr(whole, name), getattr(resumed, name)
        tolerance = 1e-12 * np.abs(one).max() if name != "certificate" else solver.accuracy
        assert np.abs(one - two).max() <= tolerance, name
    assert np.array_equal(whole.contact.sticking, resumed.contact.sticking)


OTHERS = {
    "bound": (paper_scene(bound=2.0), TIMES),
    "load": (paper_scene(lambda t: 0.5 * cyclic(t)), TIMES),
    "times": (paper_scene(), TIMES[:9]),
}


@pytest.mark.long
def test_resuming_a_finished_run_returns_it_and_refuses_other_runs(tmp_path):
    scene, mesh = paper_scene(), small("squares", 4)
    first = vx.simulate(scene, mesh, TIMES, stream=tmp_path)
    again = vx.simulate(scene, mesh, TIMES, stream=tmp_path, resume=True, progress=stop_at(1))
    for name in SERIES:
        assert np.array_equal(getattr(first, name), getattr(again, name)), name
    for other, times in OTHERS.values():
        with pytest.raises(vx.HistoryError, match="run of another scene, mesh, times or store.*empty folder"):
            vx.simulate(other, mesh, times, stream=tmp_path, resume=True)
    fresh = vx.simulate(paper_scene(cyclic), mesh, TIMES, stream=tmp_path)
    assert np.array_equal(fresh.displacement, vx.simulate(paper_scene(cyclic), mesh, TIMES).displacement)


@pytest.mark.long
def test_a_damaged_checkpoint_is_refused(tmp_path):
    scene, mesh = paper_scene(), small("squares", 4)
    vx.simulate(scene, mesh, TIMES, stream=tmp_path)
    checkpoint = tmp_path / "checkpoint.npy"
    checkpoint.write_bytes(checkpoint.read_bytes()[:100])
    with pytest.raises(vx.HistoryError, match=r"checkpoint.npy: missing, cut short or damaged.*Run without resume"):
        vx.simulate(scene, mesh, TIMES, stream=tmp_path, resume=True)


def test_a_full_disk_raises_an_error_before_the_first_step(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(vx.HistoryError, match=r"state.npy: no room for an array.*No space left"):
        vx.simulate(paper_scene(), small("squares", 4), TIMES, stream=tmp_path)


@pytest.mark.long
def test_a_killed_run_can_be_resumed(tmp_path):
    """After kill -9, stored steps are readable, and the run continues."""
    code = (
        "import sys, time; sys.path.insert(0, sys.argv[1]); import numpy as np, vemcvx as vx\n"
        "from scenes import cyclic, paper_scene, small\n"
        "vx.simulate(paper_scene(cyclic), small('squares', 5), np.linspace(0.0, 1.0, 25), stream=sys.argv[2],\n"
        "            progress=lambda n, steps: time.sleep(0.05))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(Path(__file__).parents[1] / "shared"), str(tmp_path)])
    deadline, checkpoint, done = time.time() + 60, tmp_path / "checkpoint.npy", 0
    while done <= 0 and time.time() < deadline:  # The first eight steps are recorded together.
        time.sleep(0.02)
        there = checkpoint.exists() and checkpoint.stat().st_size == 168  # a header, and five numbers
        done = int(np.load(checkpoint)[0]) if there else 0
    process.kill()
    process.wait()
    done = int(np.load(checkpoint)[0])
    assert 0 < done < 24
    scene, mesh = paper_scene(cyclic), small("squares", 5)
    first = []
    resumed = vx.simulate(scene, mesh, TIMES, stream=tmp_path, resume=True, progress=lambda n, _: first.append(n))
    assert first[0] == done + 1
    whole = vx.simulate(scene, mesh, TIMES)
    assert np.abs(resumed.displacement - whole.displacement).max() <= 1e-12 * np.abs(whole.displacement).max()
