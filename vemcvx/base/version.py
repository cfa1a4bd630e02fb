"""The version of the package, which is written into all its files."""

__version__ = "0.1.0"
