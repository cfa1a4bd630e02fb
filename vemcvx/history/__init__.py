"""What a simulation leaves, in the words of contact."""

from vemcvx.history.contact import Contact
from vemcvx.history.history import History

__all__ = ["Contact", "History"]
