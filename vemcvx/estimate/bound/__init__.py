"""Stresses in equilibrium and conforming displacements inside polygons, the two sides of a bound on the error."""
