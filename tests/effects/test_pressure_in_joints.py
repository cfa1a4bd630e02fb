"""Pressure at an interface pushes both bodies apart, whether they touch or not."""

import pytest
from scenes import mostly_long

import vemcvx as vx

STEEL = vx.Elasticity(1000.0, 0.3)


def stacked(families, n=(3, 3), dim=2):
    box = ((0, 1),) * (dim - 1)
    lower, upper = (
        (vx.meshes.FAMILIES | vx.meshes.SPACE_FAMILIES)[family](k, box=(*box, (y, y + 1)))
        for family, k, y in zip(families, n, (-1, 0), strict=True)
    )
    return vx.meshes.bodies({"low": lower, "up": upper}), lower


def blown_up(mesh, p=2.0):
    sides = vx.Clamp(on="low.bottom"), vx.Clamp(on="up.top"), vx.UnilateralContact(on="low|up")
    return vx.simulate(vx.Scene(STEEL, *sides, vx.Pressure(p, on="low|up")), mesh, [0.0, 1.0], initial="settled")


@mostly_long("family", ["squares", "triangles", "cubes", "tetrahedra"], "cubes")
def test_bodies_at_an_open_joint_deform_as_if_alone(family):
    """Each body has the displacement of a single body under the same pressure."""
    dim = 3 if family in ("cubes", "tetrahedra") else 2
    mesh, lower = stacked((family, family), dim=dim)
    alone = vx.simulate(
        vx.Scene(STEEL, vx.Clamp(on="bottom"), vx.Pressure(2.0, on="top")), lower, [0.0, 1.0], initial="settled"
    )
    history = blown_up(mesh)
    assert not history.contact.closed[-1].any()
    own = history.displacement[-1][mesh.points[:, -1] < 0]
    inner = lower.points[:, -1] < 0
    assert own == pytest.approx(alone.displacement[-1][inner], abs=1e-12)
    assert history.reaction("up.top")[-1][-1] == pytest.approx(-2.0, abs=1e-11)
    assert history.reaction("low.bottom")[-1][-1] == pytest.approx(2.0, abs=1e-11)


@pytest.mark.long
def test_contact_bears_the_difference_of_outer_and_inner_pressure():
    """The pressure is 5 outside the joint and 2 inside, so contact bears 3."""
    mesh, _ = stacked(("squares", "voronoi"), (3, 4))
    scene = vx.Scene(
        STEEL,
        vx.Symmetry(on=["low.bottom", "low.left", "low.right", "up.left", "up.right"]),
        vx.UnilateralContact(on="low|up"),
        vx.Pressure(5.0, on="up.top"),
        vx.Pressure(2.0, on="low|up"),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    assert history.force("low|up")[-1] == pytest.approx([0.0, -3.0], abs=1e-10)
    assert history.contact.pressure_recovered[-1] == pytest.approx(3.0, abs=1e-9)
    assert history.stress(-1)[:, 1] == pytest.approx(-5.0, abs=1e-9)


@mostly_long("dim", [2, 3])
def test_parts_of_an_interface_have_names(dim, tmp_path):
    """A fluid presses on one part of a joint, and friction acts on the other part."""
    mesh, _ = stacked(("squares", "squares") if dim == 2 else ("cubes", "cubes"), (4, 4), dim=dim)
    mesh = mesh.with_boundary("wet", lambda x: x[:, 0] < 0.5, of="low|up").with_boundary(
        "dry", lambda x: x[:, 0] > 0.5, of="low|up"
    )
    scene = vx.Scene(
        STEEL,
        vx.Clamp(on="low.bottom"),
        vx.Pressure(9.0, on="up.top"),
        vx.UnilateralContact(on="low|up"),
        vx.TrescaFriction(0.5, on="dry"),
        vx.Pressure(3.0, on="wet"),
        vx.Symmetry(on="up.left"),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    whole, wet, dry = (history.force(name)[-1] for name in ("low|up", "wet", "dry"))
    assert wet + dry == pytest.approx(whole, abs=1e-10)
    assert whole[-1] == pytest.approx(-9.0 + 1.5, abs=1e-9)
    assert history.force(vx.TrescaFriction)[-1][0] == pytest.approx(dry[0], abs=1e-10)
    assert wet[0] == pytest.approx(0.0, abs=1e-10)
    read = vx.read_history(history.write(tmp_path / "run"))
    assert read.force("wet")[-1] == pytest.approx(wet, abs=0.0)
    with pytest.raises(vx.MeshError, match="^with_boundary: found of = 'joint'; this mesh has the boundaries 'low"):
        mesh.with_boundary("half", lambda x: x[:, 0] < 0.5, of="joint")
