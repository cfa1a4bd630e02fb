"""The command line: `vemcvx run`, `show`, `compare`, `export`, `cost`, `collection` and further commands."""

import lazy_loader

# Import typer only for commands: other modules of this folder do not need it.
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"commands": ["app", "main"]})
