"""The force of a bolt that is tightened and locked, in closed form and in files."""

import numpy as np
import pytest

import vemcvx as vx


def column(x0, x1, low, high, cells=(1, 2)):
    return vx.meshes.squares(cells, box=((x0, x1), (low, high)))


STEEL = vx.Elasticity(300.0, 0.0)
BAR = vx.meshes.bodies({"a": column(0, 1, 0, 1), "b": column(0, 1, 1, 2)})
JOINT = {"shank": column(0, 1, 0, 1), "head": column(0, 1, 1, 3), "sleeve": column(2, 5, 0, 3)}
BOLT, SLEEVE, TENSION = 1.0, 3.0, 6.0
OPENS = TENSION * (1 + BOLT / SLEEVE)
TIMES = np.arange(7.0)
PULL = OPENS * np.array([0, 0, 0.5, 1.2, 1.5, 0.25, 0])


def tightened(x, t):
    return TENSION * t


def joint(**of):
    """Simulate a bolt and a sleeve. A force pulls their rigid cap. The sleeve is three times as stiff as the bolt."""
    mesh = vx.meshes.bodies({**JOINT, "cap": column(0, 5, 3, 4, (1, 1))})
    scene = vx.Scene(
        STEEL,
        vx.Clamp(on=["shank.bottom", "sleeve.bottom"]),
        vx.BilateralContact(on="head|cap"),
        vx.UnilateralContact(on="sleeve|cap"),
        vx.Rigid(on="cap", force=lambda x, t: (0.0, np.interp(t, TIMES, PULL)), motion=(0.0, None, 0.0)),
        vx.Pretension(on="shank|head", force=tightened, until=1.0),
    )
    return vx.simulate(scene, mesh, TIMES, **of)


@pytest.mark.parametrize(("solver", "near"), [(None, 1e-12), pytest.param(vx.Clarabel(), 1e-5, marks=pytest.mark.long)])
def test_the_bolt_follows_the_joint_diagram(solver, near):
    """The bolt bears the tension plus a quarter of the pull. In an open joint, the bolt bears the whole pull."""
    history = joint(solver=solver)
    wanted = np.maximum(TENSION * np.minimum(TIMES, 1.0) + PULL * BOLT / (BOLT + SLEEVE), PULL)
    for cause in ("shank|head", vx.Pretension):
        assert history.force(cause)[:, 1] == pytest.approx(wanted, abs=near)
    assert history.force("sleeve|cap")[:, 1] == pytest.approx(PULL - wanted, abs=near)
    assert history.force(vx.Pretension)[:, 0] == pytest.approx(np.zeros(7), abs=1e-12)
    # The overlap at the cut is the elongation of the bolt plus the shortening of the sleeve.
    up, down = (np.unique(history.mesh.boundaries["shank|head"]), history.mesh.interfaces["shank|head"].partners)
    jump = history.displacement[:, up, 1].mean(axis=1) - history.displacement[:, np.unique(down), 1].mean(axis=1)
    shorter = TENSION * 3.0 / 300.0 * (1 / BOLT + 1 / SLEEVE)
    assert jump == pytest.approx(shorter * np.minimum(TIMES, 1.0), abs=near)
    # The cut of the bolt has no contact nodes.
    edges = [history.mesh.boundaries[name].ravel() for name in ("head|cap", "sleeve|cap")]
    assert np.array_equal(history.contact.nodes, np.unique(np.concatenate(edges)))


def test_files_keep_the_forces_of_a_bolt_but_not_programs_with_infinite_weights(tmp_path):
    history = joint()
    read = vx.read_history(history.write(tmp_path / "run"))
    assert read.force("shank|head") == pytest.approx(history.force("shank|head"), abs=1e-12)
    vx.write_program(history.program(1), tmp_path / "step.npz")
    with pytest.raises(vx.ProgramError, match="1 norm terms have infinite weights"):
        vx.write_program(history.program(2), tmp_path / "step.npz")


def test_a_bolt_in_space_bears_shear_and_tension():
    """A bolt is tightened between fixed ends. Then one end is pulled and sheared."""
    cubes = vx.meshes.cubes
    behind, ahead = vx.meshes.cut(cubes((1, 1, 4), box=((0, 1), (0, 1), (0, 2))), (0, 0, 1), (0, 0, 1))
    mesh = vx.meshes.bodies({"a": behind, "b": ahead})

    def moved(x, t):
        return np.tile(np.array([0.01, 0.0, 0.02]) * max(t - 1.0, 0.0), (len(x), 1))

    scene = vx.Scene(
        STEEL,
        vx.Clamp(on="a.bottom"),
        vx.PrescribedDisplacement(moved, on="b.top"),
        vx.Pretension(on="a|b", force=2.0, until=1.0),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0, 2.0], initial="settled")
    force = history.force(vx.Pretension)
    assert force[1] == pytest.approx([0.0, 0.0, 2.0], abs=1e-12)
    assert force[2, 2] == pytest.approx(2.0 + 300.0 * 0.02 / 2.0, abs=1e-10)
    assert force[2] == pytest.approx(history.reaction("b.top")[2], abs=1e-10)
    assert force[2, 0] > 0.1


def test_a_bolt_that_is_never_locked_keeps_its_force():
    ends = vx.Clamp(on="a.bottom"), vx.PrescribedDisplacement(lambda x, t: (0.0, 0.01 * t), on="b.top")
    scene = vx.Scene(STEEL, *ends, vx.Pretension(on="a|b", force=2.0))
    history = vx.simulate(scene, BAR, [0.0, 1.0, 2.0], initial="settled")
    assert history.force("a|b")[:, 1] == pytest.approx([2.0] * 3, abs=1e-12)
