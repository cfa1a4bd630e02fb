"""Pictures of a history: each a function that returns a matplotlib figure, or draws on axes that it is given."""

import lazy_loader

# The names stand in __init__.pyi: units, colours and marks are used where nothing is drawn.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
