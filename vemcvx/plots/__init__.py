"""Pictures of a history. Each function draws on a new figure or on given axes, and returns the figure."""

import lazy_loader

# Functions are imported when first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
