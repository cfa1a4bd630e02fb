"""Polyhedra: faces listed by the cells on their two sides, areas, volumes, tetrahedral and other families."""
