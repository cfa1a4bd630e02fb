"""Derivatives of certified runs with respect to parameters of a scene, and fits of parameters to measurements."""

from vemcvx.sensitivity.derivatives import Sensitivities, sensitivities
from vemcvx.sensitivity.fitting import Fit, fit

__all__ = ["Fit", "Sensitivities", "fit", "sensitivities"]
