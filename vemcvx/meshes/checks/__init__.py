"""Checks of the points and cells that users give."""
