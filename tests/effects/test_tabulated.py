"""Data given by a table are those of the function that interpolates it."""

import numpy as np
import pytest
from scenes import small

import vemcvx as vx

INSTANTS, PULLS = [0.0, 1.0, 3.0], [0.0, 4.0, -2.0]
TIMES = np.linspace(0.0, 3.0, 7)


def block(pull, bound, lift):
    return vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Symmetry(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
        vx.PrescribedDisplacement(lift, on="top", direction="normal"),
    )


@pytest.mark.long
def test_a_table_is_the_function_that_interpolates_it():
    course = np.interp(TIMES, INSTANTS, PULLS)
    tables = (
        vx.Tabulated(INSTANTS, np.outer(PULLS, [1.0, 0.5])),
        vx.Tabulated(INSTANTS, [1.0, 2.0, 0.5]),
        vx.Tabulated(INSTANTS, [0.0, 1e-3, 0.0]),
    )
    functions = (
        lambda x, t: np.interp(t, INSTANTS, PULLS) * np.array([1.0, 0.5]),
        lambda x, t: np.interp(t, INSTANTS, [1.0, 2.0, 0.5]),
        lambda x, t: np.interp(t, INSTANTS, [0.0, 1e-3, 0.0]),
    )
    one, two = (vx.simulate(block(*data), small("voronoi", 4), TIMES) for data in (tables, functions))
    assert np.array_equal(one.displacement, two.displacement)
    assert [vx.Tabulated(INSTANTS, PULLS)(None, t) for t in TIMES] == course.tolist()
    assert "Tabulated(3 instants from 0 to 3)" in "".join(one.effects)


def test_a_table_is_its_own():
    values = np.array(PULLS)
    table = vx.Tabulated(INSTANTS, values)
    values[:] = 7.0
    assert table(None, 1.0) == 4.0
    with pytest.raises(ValueError, match="read-only"):
        table.values[0] = 1.0
