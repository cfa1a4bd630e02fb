"""The site has all public names and problem files, is built without warnings, and loads nothing from other hosts."""

from __future__ import annotations

import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import threading
from collections import Counter
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import ModuleType

import pytest
from generator import gallery, reference
from pages_seen import set_window, start_browser
from texts import PAGES, ROOT, blocks, files

import vemcvx
from vemcvx.cli.supplied import lessons, problem_files

MODULES = "meshes", "estimate.measures", "plots", "program", "effects", "vem", "testing"
"""Modules whose `__all__` is public."""
SCRIPT = ROOT / "docs" / "build.py"
FURTHER = "sphinx", "myst_nb", "furo", "numpydoc", "sphinx_design", "sphinx_copybutton", "marimo", "pandas", "xarray"


def test_every_public_name_is_on_one_page_of_the_reference():
    text = "\n".join(page.read_text(encoding="utf-8") for page in reference.PAGES.glob("*.md"))
    assert [name for name, times in Counter(reference.ENTRY.findall(text)).items() if times > 1] == []
    own = {name for name in vemcvx.__all__ if not isinstance(getattr(vemcvx, name), ModuleType)}
    public = {f"vemcvx.{name}" for name in own}
    for module in map("vemcvx.{}".format, MODULES):
        public |= {f"{module}.{name}" for name in set(importlib.import_module(module).__all__) - own}
    assert public - set(reference.OBJECTS) == set()


def test_every_problem_file_is_in_one_group_of_the_gallery():
    groups = gallery.GROUP.findall((ROOT / "docs" / "gallery" / "index.md").read_text(encoding="utf-8"))
    listed = Counter(" ".join(groups).split())
    assert set(listed) == set(gallery.list_problems()) >= set(problem_files())
    assert [name for name, times in listed.items() if times > 1] == []


def test_the_generator_stays_small():
    paths = [ROOT / "docs" / "build.py", ROOT / "docs" / "conf.py", *(ROOT / "docs" / "generator").glob("*.py")]
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths) <= 700


@pytest.mark.parametrize("name", gallery.list_problems())
def test_a_problem_has_statement_picture_and_command(name):
    problem = gallery.Problem(name)
    assert problem.title
    assert problem.statement
    assert problem.command.split()[0] in ("vemcvx", "python")
    assert problem.name in problem.command
    assert problem.pictures or name == "highs_optimal_at_zero"
    assert problem.command not in problem.statement
    assert problem.statement.count("$$") % 2 == 0
    assert not re.search(r"^ {4}(?! *\|).*(?: = | <= |sqrt)", problem.statement, re.MULTILINE)


def test_checks_of_pages_find_every_kind_of_fault(tmp_path):
    pytest.importorskip("bs4")
    from generator import checks

    good = '<article><h1 id="a">A</h1><h2>B</h2><img src="x.png" alt="a loop"><a href="//b.c/d">d</a></article>'
    (tmp_path / "x.png").touch()
    (tmp_path / "page.html").write_text(good)
    assert checks.find_faults(tmp_path) == []
    wrong = {
        "leads to none.html, which does not exist": '<a href="none.html">x</a>',
        "<script> loads https://cdn": '<script src="https://cdn.example/x.js"></script>',
        "leads to y.js": '<script src="y.js"></script>',
        "<img> of x.png has no text": '<img src="x.png">',
        "<iframe> of page.html has no text": '<iframe src="page.html"></iframe>',
        "of level 4 follows one of level 2": "<h4>C</h4>",
        "2 headings of the first level": "<h1>C</h1>",
        "a style loads //": "<style>@import '//cdn.example/x.css'</style>",
    }
    for words, html in wrong.items():
        (tmp_path / "page.html").write_text(good.replace("</article>", f"{html}</article>"))
        (fault,) = checks.find_faults(tmp_path)
        assert words in fault


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Build the whole site; return its folder."""
    for package in FURTHER:
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("site")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "JUPYTER"))}
    done = subprocess.run(
        [sys.executable, SCRIPT, folder / "site"], cwd=ROOT, env=kept, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    said = [line for line in done.stdout.splitlines() if line.startswith("site: ")]
    assert re.fullmatch(rf"site: +\d+ s  {re.escape(str(folder / 'site'))} is built", said[-1])
    assert sum(" ran " in line for line in said) > 20
    assert "WARNING" not in done.stderr
    return folder / "site"


@pytest.mark.slow
def test_the_whole_site_is_built_without_a_warning(site):
    """`find_faults` checks links, anchors, alternative texts, headings, and loaded files."""
    from generator import checks

    assert checks.find_faults(site) == []
    for number in lessons():
        text = (site / "learn" / f"lesson_{number}.html").read_text(encoding="utf-8")
        assert re.search(r'<img alt="Picture: [^"]+" src="../_images/', text)
        assert "<summary>Answer</summary>" in text
        assert (site / "learn" / "slides" / f"lesson_{number}.html").is_file()
    for name in gallery.list_problems():
        assert (site / "gallery" / f"{name}.html").is_file()
    shown = "".join(page.read_text(encoding="utf-8") for page in (site / "reference").glob("*.html"))
    assert [name for name in reference.OBJECTS if not re.search(rf'id="(?:module-)?{re.escape(name)}"', shown)] == []


SEEN = (
    "index.html",
    "learn/lesson_3.html",
    "learn/slides/lesson_3.html",
    "gallery/index.html",
    "gallery/feng_han_huang.html",
    "howto/index.html",
    "theory/certificate.html",
    "reference/contact-and-friction.html",
    "search.html?q=friction",
)
READY = "return document.readyState === 'complete' && !document.querySelector('.math:not(:has(mjx-container))')"


@pytest.fixture
def served(site):
    """Serve the site on this machine, and yield its address."""
    quiet = type("Quiet", (SimpleHTTPRequestHandler,), {"log_message": lambda *_: None})
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(quiet, directory=site))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    server.server_close()


@pytest.mark.slow
def test_pages_are_legible_in_a_browser_and_load_nothing_from_other_hosts(served, tmp_path):
    """In wide and narrow windows, formulas are rendered and pages fit."""
    from selenium.webdriver.support.wait import WebDriverWait

    with start_browser(tmp_path) as browser:
        for page in SEEN:
            for width in (1280, 380):
                set_window(browser, width)
                browser.get(served + page)
                WebDriverWait(browser, 60, poll_frequency=0.2).until(lambda b: b.execute_script(READY))
                wide = browser.execute_script("return document.documentElement.scrollWidth - window.innerWidth")
                assert wide <= 0, (page, width)
                if (page, width) == ("index.html", 380):  # The wide picture scrolls.
                    assert browser.execute_script("return document.querySelector('img.wide').width") > 600
        browser.get(served + "search.html?q=friction")
        found = "return document.querySelectorAll('#search-results li').length"
        WebDriverWait(browser, 60, poll_frequency=0.2).until(lambda b: b.execute_script(found) > 5)
        assert [line for line in browser.get_log("browser") if line["level"] == "SEVERE"] == []
        logged = [json.loads(line["message"])["message"] for line in browser.get_log("performance")]
        sent = [one["params"]["request"]["url"] for one in logged if one["method"] == "Network.requestWillBeSent"]
        assert len([url for url in sent if url.startswith(served)]) > 100
        # Addresses of the browser's own pages begin with chrome://.
        assert [url for url in sent if not url.startswith((served, "data:", "blob:", "chrome"))] == []


def list_commands(page):
    """Return the commands of the console blocks of a page, with continued lines joined."""
    lines = "".join(blocks(page.read_text(encoding="utf-8"), "console")).replace("\\\n", " ").splitlines()
    return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if list_commands(page)], ids=lambda page: page.stem)
def test_commands_of_a_page_run(page, tmp_path):
    """Commands run in order, in a folder with the files of the page and its downloads."""
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"\{download\}`([^`]+)`", text):
        shutil.copy(page.parent / name, tmp_path)
    for name, content in files(text).items():
        (tmp_path / name).write_text(content, encoding="utf-8")
    shutil.copytree(ROOT / "problems", tmp_path / "problems", ignore=shutil.ignore_patterns("pictures", "__pycache__"))
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    for command in list_commands(page):
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=tmp_path,
            env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
