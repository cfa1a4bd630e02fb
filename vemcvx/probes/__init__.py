"""What a history says at any points of the body, and along lines."""

from vemcvx.probes.places import Places, places
from vemcvx.probes.profile import Profile, profile

__all__ = ["Places", "Profile", "places", "profile"]
