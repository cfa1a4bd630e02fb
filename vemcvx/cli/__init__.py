"""The command line: `vemcvx run`, `show`, `compare`, `export`, `cost`, `collection` and further commands."""

import lazy_loader

# Worker processes, the live page and the site import modules of this folder; they do not need typer.
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"commands": ["app", "main"]})
