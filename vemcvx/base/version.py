"""The version of the package, written into all that it leaves behind."""

__version__ = "0.1.0"
