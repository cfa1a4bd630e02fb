"""Slides of the lessons."""

from __future__ import annotations

from pathlib import Path


def write(site: Path) -> None:
    """Write the slides."""
