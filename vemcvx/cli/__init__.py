"""The command line: `vemcvx run`, `show`, `compare`, `export`, `cost`, `collection` and further commands."""

import lazy_loader

# Only commands need typer.
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"commands": ["app", "main"]})
