"""Tolerances relative to the accuracy asked for: one table.

Asked is `accuracy`, a solver's setting: the certified energy error of a step, relative to the energy norm of the
states. A gap is half the square of an error: a hundredth of the accuracy is a ten-thousandth of the gap asked for.

=============== ============================== ============== ========================================================
constant        what                           asked is       why
=============== ============================== ============== ========================================================
ASKED_AGAIN     error of a step that missed    accuracy / 10  The size of the state is known now; asked for the same, a
                                                              solver would give the same.
FIXED_POINT     error of each program, where   accuracy / 10  Asked for the accuracy itself, answers stall at twice the
                weights follow pressures                      accuracy.
VISCOUS         error of a viscous step that   accuracy / 2   Asked was a part of the increment's norm, which is larger
                missed                                        than that of the state; this is a part of the state's.
FURTHER_GAP     gap at which Newton and        gap / 10,000   Below the target iterations go on while each still gains:
                proximal points stop                          they are cheap.
CONIC_GAP       gap, as an option of Clarabel  gap / 10       Its gap is not that of the certificate.
CONIC_RESIDUAL  residuals, as options of       accuracy / 100 An imbalance counts in the gap by its square, over the
                Clarabel and OSQP                             least stiffness.
CONIC_TOLERANCE tolerances of other solvers    gap / 100      What they mean differs from solver to solver.
                that cvxpy calls
COARSE_FACTORS  error of one solve with the    accuracy / 100 The certificate rests on the same factors. Above it every
                factors of K                                  step is refined in extended precision.
INTERIOR        error of the condensed         accuracy / 10  It comes on top of the step's own. Above it they are
                unknowns at a stored step                     refined once.
ADAPTED         error of a step in `adapt`     target / 100   Errors of the mesh are far larger. An accuracy finer than
                                                              that is replaced by it.
=============== ============================== ============== ========================================================

Whatever a solver claims, a step is accepted by its certificate, at 1 times the accuracy. Not parts of the accuracy are:
the rounding floor, refused above a tenth of the energy norm (:mod:`vemcvx.stepping.posed_step`); and a given initial
state, which may be out of balance by 1e-6 of it (:mod:`vemcvx.stepping.backward_euler`).
"""

from __future__ import annotations

ASKED_AGAIN = 0.1
FIXED_POINT = 0.1
VISCOUS = 0.5
FURTHER_GAP = 1e-4
CONIC_GAP = 0.1
CONIC_RESIDUAL = 0.01
CONIC_TOLERANCE = 0.01
COARSE_FACTORS = 0.01
INTERIOR = 0.1
ADAPTED = 0.01
