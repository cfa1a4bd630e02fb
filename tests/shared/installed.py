"""Tests that need packages of extras."""

from __future__ import annotations

from importlib.util import find_spec

import pytest

from vemcvx.linear import pardiso

threaded = pytest.mark.skipif(pardiso._threaded() is None, reason="no threaded oneMKL (libmkl_rt) is installed")
"""A mark of what takes PARDISO on several threads, of the extra `threads`: a gigabyte, and on x86-64 alone."""


def needs(package):
    """A mark: skipped where the package is not installed."""
    return pytest.mark.skipif(find_spec(package) is None, reason=f"{package} is not installed")
