"""Derivatives of certified runs with respect to parameters of a scene, and fits of parameters to measurements.

`sensitivities` differentiates quantities of a run: take it for gradients, for your own optimisation, or to see which
data matter. `fit` uses these derivatives for least squares: take it for parameters that explain a measured loop.
"""

from vemcvx.sensitivity.derivatives import Sensitivities, sensitivities
from vemcvx.sensitivity.fitting import Fit, fit

__all__ = ["Fit", "Sensitivities", "fit", "sensitivities"]
