"""What every page of the built site must keep to."""

from __future__ import annotations

from pathlib import Path


def faults(site: Path) -> list[str]:
    """All faults found, a line each."""
    return []
