"""Errors of a run: distances, estimates by source, and meshes and instants that meet a target."""

from vemcvx.estimate import measures as measures
