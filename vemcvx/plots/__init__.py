"""Pictures of a history: each function draws on a new figure, or on given axes, and returns the matplotlib figure."""

import lazy_loader

# Pictures, listed in __init__.pyi, are imported when first used: some modules need colours and units only.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
