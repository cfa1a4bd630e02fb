"""The live page shows numbers and pictures of a simulation, with and without a browser."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys
import time
from types import SimpleNamespace
from urllib.parse import urlsplit

import numpy as np
import pytest
from called import call
from installed import needs
from pages import words_drawn
from pages_seen import start_browser

import vemcvx as vx
from vemcvx.cli import live_page
from vemcvx.cli.problem_file import read_problem

pytestmark = needs("marimo")
FigureCanvasAgg = pytest.importorskip(
    "matplotlib.backends.backend_agg", reason="the live page needs matplotlib"
).FigureCanvasAgg
PNG = "data:image/png;base64,"
OWN_FILE = '''"""A plate pressed by <its own> file."""
import numpy as np, vemcvx as vx
def scene(young=10.0, count=3, poisson=0.25, depth=0.0, word="x"):
    press = vx.PrescribedDisplacement(lambda x, t: np.tile([0.02 * t, -0.01], (len(x), 1)), on="top")
    kinds = (vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom"))
    return vx.Scene(vx.Elasticity(young=young, poisson=poisson), press, *kinds[:{kinds}])
def mesh(n, family="triangles"):
    return vx.meshes.FAMILIES[family](n)
def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)
initial = "settled"
UNITS = {{"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}}
'''


@pytest.fixture(scope="module")
def ran():
    """Return the results of the app with the initial values of all controls."""
    return live_page._run()


@pytest.fixture
def runs_once(ran, monkeypatch):
    monkeypatch.setattr(live_page, "_run", lambda: ran)


@pytest.mark.long
def test_the_page_begins_with_a_load_cycle_on_the_papers_block(ran):
    """The load is 0, 1, -1 and 1 at t = 0, 1/3, 2/3 and 1."""
    app, found = ran
    problem = read_problem("feng_han_huang")
    scene = problem.module.scene(course=lambda t: np.interp(t, [0, 1 / 3, 2 / 3, 1], [0, 1, -1, 1]))
    history = vx.simulate(scene, vx.meshes.voronoi(16), np.linspace(0, 1, app.STEPS + 1))
    # Instants of both runs differ by rounding.
    assert np.abs(found["history"].displacement - history.displacement).max() < 1e-12
    stuck = history.contact.sticking[-1]
    numbers = {name: value for name, value, _ in found["numbers"]}
    assert list(numbers) == ["sticking", "dissipated", "duality gap", "certified error", "seconds"]
    assert numbers["sticking"] == f"{stuck.sum()} of {len(stuck)}"
    assert float(numbers["dissipated"]) == pytest.approx(history.dissipated[-1], rel=5e-3)  # shown with three digits
    assert float(numbers["certified error"]) < history.trajectory.accuracy
    assert found["drawn"].count(PNG) == found["drawn"].count("<img") == 4


def find_opened_steps(text):
    """Return the steps that an opened page shows, and check the labels."""
    steps = re.findall(r'<section aria-label="([^"]*)"( hidden)?>', text)
    found = [words for words, hidden in steps if not hidden]
    at = int(re.search(r'<input type="range" max="\d+" value="(\d+)"', text).group(1))
    assert [steps[at][0]] == found == re.findall("<output>(.*?)</output>", text)
    assert re.search(r' aria-valuetext="([^"]*)"', text).group(1) == found[0]
    return found


@pytest.mark.long
@pytest.mark.usefixtures("runs_once")
def test_an_exported_page_is_one_file_and_opens_at_the_given_step(tmp_path, monkeypatch):
    monkeypatch.setattr(live_page, "FRAMES", 2)
    file = tmp_path / "page.html"
    assert call("app", "--html", str(file)) == (0, f"{file} shows 2 of 30 steps.\n")
    text = file.read_text(encoding="utf-8")
    assert text.count("<section") == 2
    assert text.count(f'src="{PNG}') == 8
    assert find_opened_steps(text) == ["step 1 of 30, t = 0.03333"]
    assert all(words in text for words in ("bound 4.0", "path a cycle", "solver Newton"))
    assert not re.search(r"(src|href)=.?(http|/)", text)
    assert call("app", "--html", str(file), "--step", "13") == (0, f"{file} shows 3 of 30 steps.\n")
    assert find_opened_steps(file.read_text(encoding="utf-8")) == ["step 13 of 30, t = 0.4333"]
    code, output = call("app", "--html", str(file), "--step", "31")
    assert (code, output) == (2, "vemcvx: --step: found 31; this run has the steps 1 to 30.\n")


@pytest.mark.long
@pytest.mark.parametrize(
    ("kinds", "names"), [(2, ["stick and slip", "friction and its bound"]), (1, ["pressure"]), (0, [])]
)
def test_a_users_problem_file_is_shown(kinds, names, tmp_path, monkeypatch):
    """Pictures of stick and slip need friction."""
    monkeypatch.setattr(live_page, "FRAMES", 2)
    monkeypatch.setenv(live_page.GIVEN, "")  # restored at the end
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OWN_FILE.format(kinds=kinds))
    assert call("app", "own.py", "--html", "page.html") == (0, "page.html shows 2 of 30 steps.\n")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<h1>A plate pressed by &lt;its own&gt; file.</h1>" in text
    assert "scene own, family triangles, n 16, young 10.0, count 3, poisson 0.25, path as in the problem file" in text
    drawn = re.findall(r'<img [^>]*alt="([^:]*): [^"]', text.partition("</section>")[0])
    assert drawn == ["deformed body", *names, "energies"]
    app, found = live_page._run()
    assert dict(found["settings"].value) == {"young": 10.0, "count": 3, "poisson": 0.25}
    assert app.settings_of(found["problem"])["count"][1] == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.long
def test_letters_are_large_and_labels_complete(ran):
    """Letters are at least 12 px high in pictures that are 346 px wide."""
    app = ran[0]
    for name, count in [*app.SCENES.values(), ("press_fit", 4), ("janssen_silo", 4)]:
        problem = read_problem(name)
        path = app.paths_of(problem)[-1]
        history = app.solve(problem, problem.mesh(count), {}, path, "Newton")
        for kind, figure, words in app.pictures(history, 7, app.course_of(path, problem)):
            assert words
            FigureCanvasAgg(figure).draw()
            page, drawn = figure.bbox.padded(0.5), words_drawn(figure)
            assert len(drawn) > 8
            assert min(one.get_fontsize() for one in drawn) / 72 / figure.get_figwidth() * 346 >= 12.0
            for one in drawn:
                box = one.get_window_extent()
                complete = page.contains(box.x0, box.y0) and page.contains(box.x1, box.y1)
                assert complete, f"{name}, {kind}: {one.get_text()!r} is cut off"


@pytest.mark.long
def test_a_failing_cell_and_a_server_that_stops_are_errors(tmp_path, monkeypatch):
    file = tmp_path / "broken.py"
    file.write_text("import marimo\napp = marimo.App()\n\n@app.cell\ndef _():\n    1 / 0\n    return\n")
    monkeypatch.setattr(live_page, "PAGE", file)
    code, output = call("app", "--html", str(tmp_path / "page.html"))
    assert code == 2
    assert "running its cells failed" in output
    assert "ZeroDivisionError" in output
    monkeypatch.setattr(live_page.subprocess, "run", lambda command, check: SimpleNamespace(returncode=1))
    code, output = call("app", "--no-browser")
    assert code == 2
    assert "app: the server of the page has stopped" in output


@pytest.fixture
def address(tmp_path):
    """Start a server in a new process, and yield the address of the page."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "vemcvx", "app", "--no-browser", "--port", str(port)]
    printed = tmp_path / "printed"
    with printed.open("w") as out, subprocess.Popen(command, stdout=out, stderr=out) as server:
        try:
            deadline = time.monotonic() + 120
            while not (found := re.search(rf"http://localhost:{port}/?\?access_token=[\w-]+", printed.read_text())):
                assert server.poll() is None, printed.read_text()
                assert time.monotonic() < deadline, printed.read_text()
                time.sleep(0.2)
            while not is_answering(port):
                assert time.monotonic() < deadline, printed.read_text()
                time.sleep(0.2)
            yield found.group()
            server.send_signal(signal.SIGINT)
            assert server.wait(timeout=60) == 0
        finally:
            server.kill()
    assert "The page has ended." in printed.read_text()
    assert not is_answering(port)


def is_answering(port):
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


NUMBERS = "return [...document.querySelectorAll('dl div')].map(e => e.innerText.split(/\\s+/).join(' '))"
SLIDERS = "return [...document.querySelectorAll('marimo-slider')].map(e => e.shadowRoot)"
PICTURE = "const i = document.querySelector('img[alt^=deformed]'); return i && i.naturalWidth > 700 ? i.src : null"


@pytest.mark.slow
def test_sliders_change_numbers_and_picture_in_a_browser(ran, address, tmp_path):
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.wait import WebDriverWait

    def shown(after):
        """Return the picture and the numbers of the page as soon as both differ from `after`."""
        waiting = WebDriverWait(browser, 120, poll_frequency=0.2)
        picture = waiting.until(lambda b: (now := b.execute_script(PICTURE)) != after[0] and now)
        numbers = waiting.until(lambda b: (now := b.execute_script(NUMBERS)) != after[1] and len(now) == 5 and now)
        return picture, numbers

    def expected(history, step):
        """Return the first two numbers of a step."""
        return [" ".join(number) for number in app.numbers_of(history, step)][:2]

    app, found = ran
    with start_browser(tmp_path) as browser:
        browser.get(address)
        first = shown((None, []))
        assert first[1][:2] == expected(found["history"], app.STEPS)
        # The page has all controls twice, once for narrow windows.
        sliders = [host.find_element("css selector", "[role=slider]") for host in browser.execute_script(SLIDERS)]
        step, *settings, _ = [slider for slider in sliders if slider.is_displayed()]
        step.send_keys(Keys.ARROW_LEFT)
        second = shown(first)
        assert second[1][:2] == expected(found["history"], app.STEPS - 1)
        settings[list(found["settings"].value).index("bound")].send_keys(Keys.ARROW_LEFT)
        third = shown(second)
        values = {**found["settings"].value, "bound": 3.6}
        weaker = app.solve(found["problem"], found["mesh"], values, "a cycle", "Newton")
        assert third[1][:2] == expected(weaker, app.STEPS - 1)
        assert [line for line in browser.get_log("browser") if line["level"] == "SEVERE"] == []
        requests = [json.loads(line["message"])["message"]["params"] for line in browser.get_log("performance")]
    page = f"http://{urlsplit(address).netloc}/"
    urls = [one["request"]["url"] for one in requests if one.get("documentURL") == page and "request" in one]
    assert len(urls) > 10
    assert [url for url in urls if not url.startswith((page, "data:", "blob:"))] == []
