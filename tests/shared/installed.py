"""A mark for tests that need an optional package."""

from __future__ import annotations

from importlib.util import find_spec

import pytest


def needs(package):
    """Return a mark that skips a test if the package is not installed."""
    return pytest.mark.skipif(find_spec(package) is None, reason=f"{package} is not installed")
