"""Meshes and instants for the accuracy asked."""

from vemcvx.adaptivity.adaptive import Adapted, Pass, adapt

__all__ = ["Adapted", "Pass", "adapt"]
