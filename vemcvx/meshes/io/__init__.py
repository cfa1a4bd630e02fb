"""Mesh files, through meshio."""
