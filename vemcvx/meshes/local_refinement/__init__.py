"""Local refinement: chosen cells are split, neighbours keep their shape and get hanging nodes."""
