"""Meshes and instants for the accuracy asked."""

from vemcvx.estimate.adapt.adapted import Adapted, Pass, adapt

__all__ = ["Adapted", "Pass", "adapt"]
