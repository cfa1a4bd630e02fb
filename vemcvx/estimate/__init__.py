"""Errors of runs, error estimates, and adaptive meshes and instants."""

from vemcvx.estimate import measures as measures
