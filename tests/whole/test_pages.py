"""The pages of the site that are written: their Python runs, and what they name exists."""

from __future__ import annotations

import re

import pytest
from texts import PAGES, ROOT, SITE, cells, outside, prose


def name(page):
    return str(page.relative_to(SITE).with_suffix(""))


RUN = [page for page in PAGES if cells(page.read_text())]


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN, ids=name)
def test_the_cells_of_a_page_run(page, tmp_path, monkeypatch):
    """In an empty folder, as the site runs them; what they claim they assert."""
    monkeypatch.chdir(tmp_path)
    known = {"__name__": "__main__"}
    for i, cell in enumerate(cells(page.read_text())):
        exec(compile(cell, f"{name(page)}, cell {i}", "exec"), known)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_and_files_of_a_page_exist(page):
    text = prose(page.read_text())
    for target in re.findall(r"\]\(([^)#\s]+?\.\w+)(?:#[^)]*)?\)", text):
        if target.startswith("/pictures/"):
            assert (ROOT / "problems" / target[1:]).exists(), target
        elif not target.startswith("http"):
            assert (page.parent / target).exists() or outside(page, target), target
    for path in re.findall(r"\{file\}`([^`]+)`", text):
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_headings_follow_in_order(page):
    """One title, and no level is skipped."""
    levels = [len(marks) for marks in re.findall(r"^(#+) ", prose(page.read_text()), re.MULTILINE)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in zip(levels, levels[1:], strict=False))
