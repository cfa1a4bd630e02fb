"""Pages that are written from where their matter lives: lessons, problem files, docstrings."""
