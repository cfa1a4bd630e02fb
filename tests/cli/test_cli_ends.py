"""How the command line ends where it has hardly begun, and how much of what was typed it says again."""

from __future__ import annotations

import os
import subprocess
import sys
from types import SimpleNamespace

import pytest
from test_cli_supplied import call

import vemcvx as vx
from vemcvx.stepping.fixed_point import _not_contracting

STARTS = """
import os, signal, time
os.kill(os.getpid(), signal.SIGINT)
time.sleep(30)
"""


@pytest.mark.long
@pytest.mark.parametrize("script", [True, False])
def test_ctrl_c_while_the_package_is_imported_is_a_line(tmp_path, script):
    (tmp_path / "threadpoolctl.py").write_text(STARTS)
    (tmp_path / "vemcvx-script").mkdir()
    start = tmp_path / "vemcvx-script" / "vemcvx"
    start.write_text("from vemcvx.cli import main\nmain()\n")
    command = [sys.executable, start] if script else [sys.executable, "-m", "vemcvx", "problems"]
    here = os.path.dirname(os.path.dirname(vx.__file__))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), here])}
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=25, cwd=tmp_path)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "vemcvx: interrupted.\n")


@pytest.mark.long
def test_ctrl_c_while_commands_are_built_is_a_line(tmp_path):
    start = tmp_path / "vemcvx"
    build = f"def build(app):{STARTS.replace(chr(10), chr(10) + '    ')}"
    lines = ["import typer.main", "from vemcvx.cli import main", build, "typer.main.get_command = build", "main()"]
    start.write_text("\n".join(lines))
    command = [sys.executable, start, "problems"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=25, cwd=tmp_path)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "vemcvx: interrupted.\n")


@pytest.mark.long
def test_as_a_library_ctrl_c_stays_what_it_was(tmp_path):
    code = "import signal, vemcvx; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "True\n"


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


@pytest.mark.parametrize(("rate", "how"), [(0.99, "contracts with the rate 0.99 only"), (0.0987, "does not settle")])
def test_a_fixed_point_that_is_not_reached_says_why(rate, how):
    step = SimpleNamespace(n=1, subject="the fixed point", advice="Try something else.")
    said = str(_not_contracting(step, 1.0, rate, "after 50 programs"))
    assert said == f"step 1 at t = 1: the fixed point {how}: after 50 programs. Try something else."
