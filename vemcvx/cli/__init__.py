"""The command line: `vemcvx run`, `show`, `compare`, `export`, `cost`, `collection`, and others on what came along."""

import lazy_loader

# Worker processes, the live page and the site use modules in here, and need no typer.
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"commands": ["app", "main"]})
