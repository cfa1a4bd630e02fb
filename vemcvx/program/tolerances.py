"""Tolerances relative to the accuracy asked for: two parts of it, in one table.

Asked is `accuracy`, a solver's setting: the certified energy error of a step, relative to the energy norm of the
states. A gap is half the square of an error: a hundredth of the accuracy is a ten-thousandth of the gap asked for.

========= ==================================== ============== ========================================================
constant  what                                 asked is       why
========= ==================================== ============== ========================================================
SHARE     error of a step that missed          accuracy / 10  The size of the state is known now; asked for the same, a
                                                              solver would give the same.
SHARE     gap of each program, where weights   gap / 10       Asked for the gap itself, answers stall above it.
          follow pressure or slip
SHARE     error of the condensed unknowns at   accuracy / 10  It comes on top of the step's own. Above it they are
          a stored step                                       refined once.
SHARE     gap, as an option of Clarabel        gap / 10       Its gap is not that of the certificate.
UNSEEN    residuals, as options of Clarabel    accuracy / 100 An imbalance counts in the gap by its square, over the
          and OSQP                                            least stiffness.
UNSEEN    tolerances of other solvers that     gap / 100      What they mean differs from solver to solver.
          cvxpy calls
UNSEEN    error of a step in `adapt`           target / 100   Errors of the mesh are far larger. An accuracy finer than
                                                              that is replaced by it.
========= ==================================== ============== ========================================================

Whatever a solver claims, a step is accepted by its certificate, at 1 times the accuracy. Not parts of the accuracy are:
the rounding floor, refused above a tenth of the energy norm (:mod:`vemcvx.stepping.refusals`); and a given initial
state, which may be out of balance by 1e-6 of it (:mod:`vemcvx.stepping.backward_euler`).
"""

from __future__ import annotations

SHARE = 0.1
UNSEEN = 0.01
