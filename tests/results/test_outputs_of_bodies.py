"""Files and pictures of contact between bodies show both sides."""

import matplotlib.pyplot as plt
import meshio
import numpy as np
import pytest
from matplotlib.quiver import Quiver
from scenes import small

import vemcvx as vx
from vemcvx import plots

JOINT = "lower|upper"


@pytest.fixture(scope="module")
def history():
    """The upper block is dragged and tilts. Contact sticks, slips and opens."""
    scene = vx.Scene(
        vx.Elasticity(10.0, 0.3),
        vx.Clamp(on="lower.bottom"),
        vx.Pressure(lambda x, t: t * (0.2 + 2 * x[:, 0]), on="upper.top"),
        vx.Traction(lambda x, t: np.tile([0.5 * t, 0.0], (len(x), 1)), on="upper.left"),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(0.6, on=JOINT),
    )
    blocks = {"lower": small("hexagons", 4), "upper": vx.meshes.hexagons(5, box=((0, 1), (1, 2)))}
    return vx.simulate(scene, vx.meshes.bodies(blocks), np.linspace(0, 1, 5))


def test_files_have_contact_on_both_sides(history, tmp_path):
    contact = history.contact
    history.write(tmp_path)
    found = meshio.read(tmp_path / "step_0004.vtu").point_data
    assert np.abs(contact.traction[-1]).max() > 0
    for name, sign in {"traction": -1, "slip": -1, "pressure": 1, "wear": 1, "bound": 1, "closed": 1}.items():
        own, other = found[name][contact.nodes], found[name][contact.partners]
        assert np.array_equal(other, sign * own)
        assert np.array_equal(own[..., :2] if own.ndim > 1 else own, getattr(contact, name)[-1])


def test_arrows_on_the_two_bodies_cancel(history):
    ax = plots.deformed_mesh(history).axes[0]
    arrows = [one for one in ax.get_children() if isinstance(one, Quiver)]
    forces = np.concatenate([np.column_stack([one.U, one.V]) for one in arrows])
    assert np.abs(forces).max() > 0
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 * np.abs(forces).sum()
    plt.close("all")
