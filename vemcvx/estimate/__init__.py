"""Errors of a run: distances, estimates part by part, meshes and instants that meet a target."""

from vemcvx.estimate import measures as measures
