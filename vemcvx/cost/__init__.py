"""The cost of accuracy: true errors, seconds, unknowns and memory of many settings of one problem; and studies."""
