"""Lines on a terminal break between words, lines in pipes do not break, and an interrupt prints one line."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from called import call

from vemcvx.cli import terminal

SMALL = ("feng_han_huang", "--n", "4")
COMMANDS = {
    "run": ("run", *SMALL, "--steps", "2", "--out", "results/of/a/run/by/its/name"),
    "show": ("show", *SMALL),
    "compare": ("compare", *SMALL, "--steps", "2", "--solvers", "newton,clarabel,direct"),
    "an error": ("run", "nothing"),
    "a warning": ("run", "cattaneo_mindlin", "--n", "4", "--steps", "2", "--mesh", "triangles"),
    "help": ("run", "--help"),
}
TERMINAL = SimpleNamespace(isatty=lambda: True)


def split_words(text):
    """Return the ASCII words without digits."""
    return {word for word in text.split() if word.isascii() and not any(map(str.isdigit, word)) and word != "-"}


@pytest.mark.long
@pytest.mark.parametrize("name", COMMANDS)
def test_a_terminal_of_80_columns_shows_whole_words(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    whole = split_words(call(*COMMANDS[name])[1])
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(terminal, "sys", SimpleNamespace(stdout=TERMINAL, stderr=TERMINAL))
    shown = call(*COMMANDS[name])[1]
    assert max(map(len, shown.splitlines())) <= 80
    assert split_words(shown) <= whole


def test_an_interrupt_prints_one_line(tmp_path):
    file = tmp_path / "stopped.py"
    body = "signal.raise_signal(signal.SIGINT)\n    time.sleep(60)"
    file.write_text(f"import signal, time\n\ndef scene(*given):\n    {body}\n\nmesh = times = scene\n")
    code, shown = call("run", str(file))
    assert code == 130
    assert shown.count("\n") == 1
    assert shown.startswith("vemcvx: interrupted; `run --resume DIR` continues")
