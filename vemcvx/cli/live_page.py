"""`vemcvx app`: a page in the browser on which a problem is changed and solved anew; it is a marimo app.

The app is `live_page.py` beside the problem files.
"""

from __future__ import annotations

import importlib.util
import os
import secrets
import socket
import sys
import threading
import time
import webbrowser
from collections import deque
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from vemcvx.base.errors import ProblemError
from vemcvx.cli.options import problem_names
from vemcvx.cli.problem_file import executed, own_errors
from vemcvx.cli.report import page
from vemcvx.cli.supplied import problems_folder
from vemcvx.cli.terminal import check_writable, logged_at_most, say, write_text

GIVEN = "VEMCVX_APP"
PAGE = "live_page.py"
HOST = "127.0.0.1"
MOST_SESSIONS = 6
LINGER = 10  # Seconds for which a page that was closed, or lost its connection, is kept.
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]
FRAMES = 11
STYLE = "h1{font-size:1.4em}dd b{font-size:1.4em}label{display:flex;gap:1em;flex-wrap:wrap}input{flex:1 1 12em}"
SHOW = """
const steps = [...document.querySelectorAll('section')];
steps.forEach((one, k) => one.hidden = k != this.value);
this.nextElementSibling.value = this.ariaValueText = steps[this.value].ariaLabel"""


@dataclass(frozen=True, kw_only=True)
class App:
    """Open a live page: change scene, mesh, friction, load and solver, and see what sticks and slips (extra app)."""

    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            autocompletion=problem_names,
            help="A problem file, or a name that `problems` lists. (default: the block of the example)",
        ),
    ] = ""
    port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Port of the page on this machine. (default: a free one)")
    ] = None
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True
    check: Annotated[bool, typer.Option("--check", help="Run it without a browser, and say whether it works.")] = False
    html: Annotated[Path | None, typer.Option(metavar="PAGE", help="Write it as a page that needs no Python.")] = None
    step: Annotated[int | None, typer.Option(min=1, help="The step that PAGE opens at. (default: its first)")] = None

    def __call__(self) -> None:
        """Serve the page until Ctrl-C, or check it, or write it to a file."""
        if self.check and self.html is not None:
            raise ProblemError("app: found --check and --html; give one of them.")
        if self.step is not None and self.html is None:
            raise ProblemError("app: found --step without --html; the live page has a slider for the step.")
        # The app finds its problem file in the environment, where it begins anew for every page that is opened.
        os.environ[GIVEN] = str(Path(self.file).resolve()) if Path(self.file).is_file() else self.file
        if self.html is not None:
            check_writable(self.html, "--html")
            say(write(self.html, self.step))
        elif self.check:
            say(check())
        else:
            try:
                serve(self.port, self.browser)
            except KeyboardInterrupt:
                say("The page has ended.")
                # marimo's sessions leave threads behind, and the interpreter that took itself down beside them failed
                # now and then in its last flush of standard output (exit code 120). Nothing is left to do but to end.
                for stream in (sys.stdout, sys.stderr):
                    stream.flush()
                os._exit(0)


def check() -> str:
    """Run all cells of the app in this process, without a browser, and return a line with the certificate."""
    start = time.perf_counter()
    with logged_at_most(0):
        _, cells, found = _run()
    error, steps = found["history"].certified.max(), found["history"].steps
    seconds = time.perf_counter() - start
    return f"app: all {cells} cells run, in {seconds:.1f} s; {steps} steps are certified to {error:.0e}."


def serve(port: int | None, browser: bool) -> None:
    """Offer the page to browsers on this machine, at that port or at any that is free, until Ctrl-C."""
    try:
        listener = socket.create_server((HOST, port or 0))
    except OSError as error:
        raise ProblemError(f"--port: {port} cannot be had: {os.strerror(error.errno or 0)}; take another.") from error
    with listener:
        with logged_at_most(0):
            _run()  # what does not work is told before anybody looks
        import uvicorn
        from marimo import create_asgi_app

        port, token = listener.getsockname()[1], secrets.token_urlsafe(24)
        own: list[Any] = []

        def seen(app: Any) -> Any:
            own.append(app)
            return app

        made = create_asgi_app(quiet=True, token=token, session_ttl=LINGER)
        made = made.with_app(path="/", root=str(problems_folder() / PAGE), middleware=[seen])
        settings = uvicorn.Config(Door(made.build(), port), log_level="warning", timeout_graceful_shutdown=1)
        server = uvicorn.Server(settings)
        address = f"http://{HOST}:{port}/?access_token={token}"
        say(f"The page is at {address}\nCtrl-C ends it.")
        if browser:
            opener = threading.Timer(1.0, webbrowser.open, [address])
            opener.daemon = True
            opener.start()
        try:
            server.run(sockets=[listener])  # Ctrl-C raises KeyboardInterrupt in there
        finally:
            # A session is a thread that waits for its page, and the process for its threads.
            for one in own:
                one.state.session_manager.close_all_sessions()
        raise ProblemError("app: the server of the page has ended by itself; what it printed says why.")


class Door:
    """The door of the page: browsers of this machine come in, pages of other sites do not.

    A request must name this machine and port as its host, so that no name of another site leads here, and no other
    origin than the page itself. (marimo checks the token in the page's address.) Every open page is a session that
    takes some 20 MB of memory, so that their number is bounded.
    """

    def __init__(self, app: Application, port: int):
        self._app = app
        self._hosts = {f"{name}:{port}" for name in (HOST, "localhost")}
        self._open, self._ended = 0, deque[float]()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on a request, or refuse it; a session counts from when the page, and its token, has let it in."""
        session, accepted = scope["type"] == "websocket", False
        if refusal := self._refusal(scope, session):
            await _refuse(send, session, *refusal)
            return

        async def told(message: MutableMapping[str, Any]) -> None:
            nonlocal accepted
            if message["type"] == "websocket.accept" and not accepted:
                accepted = True
                self._open += 1
            await send(message)

        try:
            await self._app(scope, receive, told)
        finally:
            if accepted:
                self._open -= 1
                self._ended.append(time.monotonic())

    def _refusal(self, scope: Scope, session: bool) -> tuple[int, str] | None:
        """The status and the sentence of a request that does not come in."""
        if not session and scope["type"] != "http":
            return None
        named = {key.decode("latin-1"): value.decode("latin-1") for key, value in scope["headers"]}
        if named.get("host") not in self._hosts:
            return 403, f"This page is at http://{HOST}, on the machine that shows it."
        if "origin" in named and named["origin"].removeprefix("http://") not in self._hosts:
            return 403, "Pages of other sites may not use this one."
        # Pages closed so lately that marimo still keeps them count, too.
        while self._ended and self._ended[0] < time.monotonic() - LINGER:
            self._ended.popleft()
        if self._open + len(self._ended) >= MOST_SESSIONS and (session or scope["path"] == "/"):
            return 503, f"This page is open {MOST_SESSIONS} times; close one, and wait {LINGER} s."
        return None


async def _refuse(send: Send, session: bool, status: int, words: str) -> None:
    """Answer in a sentence; a session that has not begun is closed, which servers answer by 403."""
    if session:
        await send({"type": "websocket.close", "code": 1008, "reason": words})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": words.encode()})


def write(path: Path, opens: int | None = None) -> str:
    """Write a page of pictures and numbers, step by step, that needs nothing else; return a line that says so.

    It opens at the first step, or at the step asked for.
    """
    module, _, found = _run()
    history, problem = found["history"], found["problem"]
    course, units = module.course_of(found["path"].value, problem), problem.units
    first = 1 if opens is None else opens
    if not first <= history.steps:
        raise ProblemError(f"--step: found {first}; this run has the steps 1 to {history.steps}.")
    steps = sorted({first, *np.linspace(1, history.steps, FRAMES).round().astype(int).tolist()})
    at = {n: f"step {n} of {history.steps}, t = {history.times[history.row(n)]:.4g}" for n in steps}
    shown = "".join(
        f'<section aria-label="{at[n]}"{"" if n == first else " hidden"}>'
        f"{module.told(module.numbers_of(history, n))}"
        f"{module.shown(module.pictures(history, n, course, units))}</section>"
        for n in steps
    )
    slider = (
        f'<label>time<input type="range" max="{len(steps) - 1}" value="{steps.index(first)}" autocomplete="off" '
        f'aria-valuetext="{at[first]}" oninput="{escape(SHOW)}"><output>{at[first]}</output></label>'
    )
    chosen = {name: found[name].value for name in ("scene", "family", "n")} | dict(found["settings"].value)
    chosen |= {"path": found["path"].value, "solver": found["solver"].value}
    words = ", ".join(f"{name} {value}" for name, value in chosen.items())
    text = page(problem.title, f"<p>{escape(words)}</p>{slider}{shown}", STYLE)
    write_text(path, text, "--html")
    return f"{path}: {len(steps)} of {history.steps} steps"


def _run() -> tuple[Any, int, Mapping[str, Any]]:
    """The module of the app, how many cells it has, and what they define."""
    if importlib.util.find_spec("marimo") is None:
        raise ProblemError("app: the live page needs marimo, which is not installed: pip install 'vemcvx[app]'")
    path = problems_folder() / PAGE
    module = executed(path, "app")
    outputs, found = own_errors(path, "running its cells", module.app.run)
    return module, len(outputs), found
