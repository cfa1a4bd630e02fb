"""Live pages of two scenes, on which time moves: what `vemcvx app FILE --html PAGE` writes, which loads nothing."""

from __future__ import annotations

import os
from pathlib import Path

from vemcvx.cli.live_page import GIVEN
from vemcvx.cli.live_page import write as write_page
from vemcvx.cli.terminal import logged_at_most

SCENES = {"feng_han_huang": 30, "frictional_hysteresis": 20}
"""Names of problem files, and the step at which their page opens."""


def write(folder: Path) -> None:
    """Write a page for each scene that is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, step in SCENES.items():
        path = folder / f"{name}.html"
        if not path.is_file():
            os.environ[GIVEN] = name
            with logged_at_most(0):  # what a run of so few steps warns of is not the site's
                write_page(path, step)
