"""`vemcvx app`: a page in the browser on which a problem is changed and solved anew; it is a marimo app.

The app is `live_page.py` beside the problem files.
"""

from __future__ import annotations

import importlib.util
import os
import socket
import subprocess
import sys
import time
from base64 import b64encode
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from vemcvx.cli.pages import page
from vemcvx.cli.python_file import executed, own_errors
from vemcvx.cli.supplied import problems_folder
from vemcvx.errors import ProblemError

HOST = "127.0.0.1"
FRAMES = 10
STYLE = (
    "h1{font-size:1.5em}img{width:100%}dl{display:flex;gap:1em 2.5em;flex-wrap:wrap}"
    "dt{color:#666}dd{margin:0}dd b{font-size:1.4em}label{display:flex;gap:1em}input{flex:1}"
)
SHOW = "for (const [k, one] of document.querySelectorAll('section').entries()) one.hidden = k != this.value"


def check() -> str:
    """Run all cells of the app in this process, without a browser; what was found, in a line."""
    start = time.perf_counter()
    _, cells, found = _run()
    error, steps = found["history"].certificate.max(), found["history"].steps
    seconds = time.perf_counter() - start
    return f"app: all {cells} cells run, in {seconds:.1f} s; {steps} steps are certified to {error:.0e}."


def serve(port: int | None, browser: bool) -> None:
    """Let marimo offer the page to browsers on this machine, at that port or at any that is free, until Ctrl-C.

    Raises
    ------
    ProblemError
        The port is taken, or the app does not run here.
    """
    if port is not None:
        _check_free(port)
    _run()  # what does not work is told before anybody looks
    where = ["--host", HOST, *([] if port is None else ["--port", str(port)])]
    command = [sys.executable, "-m", "marimo", "--yes", "run", str(_path()), *where]
    with subprocess.Popen(command if browser else [*command, "--headless"]) as server:
        try:
            server.wait()
        finally:
            server.terminate()


def write(path: Path) -> str:
    """Write a page of pictures and numbers, step by step, that needs nothing else; what was done, in a line."""
    module, _, found = _run()
    history, course = found["history"], module.course_of(found["path"].value, found["problem"])
    steps = [history.steps * k // FRAMES for k in range(1, FRAMES + 1)]
    frames = [_frame(module.picture(history, step, course), module.numbers_of(history, step)) for step in steps]
    hidden = [*(f"<section hidden>{frame}</section>" for frame in frames[:-1]), f"<section>{frames[-1]}</section>"]
    slider = f'<label>time<input type="range" max="{FRAMES - 1}" value="{FRAMES - 1}" oninput="{escape(SHOW)}"></label>'
    chosen = ", ".join(f"{name} {found[name].value}" for name in ("scene", "family", "n", "bound", "path", "solver"))
    text = page(found["problem"].title, f"<p>{escape(chosen)}</p>{slider}{''.join(hidden)}", STYLE)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ProblemError(f"--html: {path} cannot be written: {error.strerror}.") from error
    return f"{path}: {FRAMES} of {history.steps} steps"


def _frame(png: bytes, numbers: list[tuple[str, str, str]]) -> str:
    told = "".join(f"<div><dt>{k}</dt><dd><b>{v}</b> <small>{escape(c)}</small></dd></div>" for k, v, c in numbers)
    return f'<dl>{told}</dl><img alt="" src="data:image/png;base64,{b64encode(png).decode()}">'


def _path() -> Path:
    return problems_folder() / "live_page.py"


def _run() -> tuple[Any, int, Mapping[str, Any]]:
    """The module of the app, how many cells it has, and what they define."""
    if importlib.util.find_spec("marimo") is None:
        raise ProblemError("app: the live page needs marimo, which is not installed: pip install 'vemcvx[app]'")
    module = executed(_path(), "app")
    outputs, found = own_errors(_path(), "running its cells", module.app.run)
    return module, len(outputs), found


def _check_free(port: int) -> None:
    try:
        with socket.create_server((HOST, port)):
            pass
    except OSError as error:
        raise ProblemError(f"--port: {port} cannot be had: {os.strerror(error.errno or 0)}; take another.") from error
