"""Pages that are written from lessons, problem files and docstrings."""
