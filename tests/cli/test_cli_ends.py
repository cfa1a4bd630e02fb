"""How much of what was typed messages say again."""

from __future__ import annotations

import pytest
from test_cli_supplied import call

import vemcvx as vx

LONG = "a" * 100_000


@pytest.mark.parametrize(
    "act",
    [
        lambda: vx.simulate(vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(on=LONG)), vx.meshes.squares(1), [0.0, 1.0]),
        lambda: vx.simulate(vx.Scene(vx.Elasticity(LONG, 0.3), vx.Clamp(on="left")), vx.meshes.squares(1), [0.0, 1.0]),
        lambda: vx.meshes.squares(1).write(f"{LONG}.vtu"),
        lambda: vx.meshes.read(f"{LONG}.vtu"),
        lambda: vx.meshes.bodies({LONG: vx.meshes.squares(1), "b": 3}),
        lambda: vx.read_history(LONG),
        lambda: vx.read_program(LONG),
        lambda: vx.ThroughCvxpy(LONG).prepare(None),
    ],
)
def test_messages_are_no_longer_than_a_page(act):
    with pytest.raises(vx.VemcvxError) as caught:
        act()
    assert len(str(caught.value)) < 2_100


@pytest.mark.long
@pytest.mark.parametrize("words", [("run", LONG), ("show", f"{LONG}.py"), ("run", "feng_han_huang", "--solver", LONG)])
def test_commands_say_no_more_than_a_page(words):
    code, said = call(*words)
    assert code == 2
    assert len(said) < 5_000
