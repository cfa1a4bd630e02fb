"""Geometry of many polygons at once, in flat arrays."""
