"""The command line: `vemcvx run`, `show`, `compare`, `export`, `cost`, `collection` and further commands."""

import lazy_loader

# Import typer only for commands: worker processes, the live page and the site use other modules of this folder.
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"commands": ["app", "main"]})
