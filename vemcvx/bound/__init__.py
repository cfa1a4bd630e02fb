"""Guaranteed bounds on the error: admissible stresses and displacements, and what the skeleton of a mesh bears."""
