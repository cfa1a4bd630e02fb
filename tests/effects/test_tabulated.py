"""A table of data equals the function that interpolates it."""

import numpy as np

import vemcvx as vx

INSTANTS, PULLS = [0.0, 1.0, 3.0], [0.0, 4.0, -2.0]


def test_a_table_equals_the_function_that_interpolates_it():
    times = np.linspace(0.0, 3.0, 7)
    vector, scalar = vx.Tabulated(INSTANTS, np.outer(PULLS, [1.0, 0.5])), vx.Tabulated(INSTANTS, PULLS)
    assert [scalar(None, t) for t in times] == np.interp(times, INSTANTS, PULLS).tolist()
    wanted = np.outer(np.interp(times, INSTANTS, PULLS), [1.0, 0.5])
    np.testing.assert_array_equal([vector(None, t) for t in times], wanted)
    steel, held = vx.Elasticity(200.0, 0.3), vx.Clamp(on="right")
    one, two = (
        vx.simulate(vx.Scene(steel, held, vx.Traction(load, on="left")), vx.meshes.squares(2), times)
        for load in (vector, lambda x, t: np.interp(t, INSTANTS, PULLS) * np.array([1.0, 0.5]))
    )
    assert np.array_equal(one.displacement, two.displacement)
    assert "Tabulated(3 instants from 0 to 3)" in "".join(one.effects)
