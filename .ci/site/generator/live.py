"""Live pages of two scenes, on which time moves."""

from __future__ import annotations

from pathlib import Path


def write(folder: Path) -> None:
    """Write the pages."""
