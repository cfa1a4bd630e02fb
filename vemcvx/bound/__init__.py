"""Guaranteed bounds on the error, by admissible stresses and admissible displacements.

C is the elastic tensor, eps(v) the strain of a displacement v, and (., .) the integral of a product over the body. A
stress tau has the norm |tau|^2 = (tau, C^-1 tau), and v has |v|^2 = a(v, v) = (C eps(v), eps(v)), or |v|_a^2.

**The step.** u minimises J(v) = a(v, v) / 2 + (sigma_0, eps(v)) - l(v) + j(v) over the displacements that supports
admit, with the prestress sigma_0 and the work l(v) of the loads. The convex j(v) is the energy of friction with a given
bound and of compliant obstacles, and infinite beyond rigid obstacles. So sigma = sigma_0 + C eps(u) satisfies

    (sigma, eps(v - u)) - l(v - u) + j(v) - j(u)  >=  0      for all admissible v.                                (1)

**The pair.** v is admissible, and j(v) is finite. A friction q and a pressure p act on the contact boundary. tau is a
stress in equilibrium with the loads, q and p. So for all motions w that vanish on supports

    (tau, eps(w))  =  l(w) - int (q w_t + p w_n),                                                                 (2)

with the tangential and outward components w_t and w_n of w. Moreover, h(w) := j(w) - int (q w_t + p w_n) is bounded
from below. Let r = tau - sigma_0 - C eps(v), A = |r|, b = h(v) - inf h >= 0.

**Theorem 1** (Prager and Synge, with friction and contact). For e = u - v

    |e|^2 + (h(u) - inf h)  <=  A |e| + b,        |e|  <=  A / 2 + (A^2 / 4 + b)^{1/2},
    |tau - sigma|^2 + |e|^2  <=  A^2 + 2 b,       J(v) - A^2 / 2 - b  <=  J(u)  <=  J(v).

*Proof.* |e|^2 = (sigma - sigma_0 - C eps(v), eps(e)) <= l(e) + j(v) - j(u) - (sigma_0 + C eps(v), eps(e)) by (1). With
(2) for w = e, l(e) = (tau, eps(e)) + int (q e_t + p e_n), and j(v) - j(u) + int (q e_t + p e_n) = h(v) - h(u). This
proves the first inequality. Since h(u) >= inf h, the second follows from x^2 <= A x + b. Let X = tau - sigma.
Then r = X + C eps(e), and (X, eps(e)) >= h(u) - h(v) >= -b by (1) and (2). So |r|^2 = |X|^2 + |e|^2 + 2 (X, eps(e))
proves the third. For the fourth, J(v) - J(u) = |e|^2 / 2 + (a number >= 0, by (1)). By (2), J(v) - J(u) = (r, eps(e)) +
h(v) - h(u) - |e|^2 / 2 <= A |e| + b - |e|^2 / 2 <= A^2 / 2 + b.

**Theorem 2** (lower bound). If w vanishes on supports and where friction and obstacles act, then |e| >= R(w) / |w| with
the residual R(w) = l(w) - (sigma_0 + C eps(v), eps(w)), and J(u) <= J(v) - (R(w) / |w|)^2 / 2. *Proof.* Both u + w and
u - w satisfy (1) in place of v, so (sigma, eps(w)) = l(w) and R(w) = a(e, w). Then minimise J(v + s w) over numbers s.

**Theorem 3** bounds errors of quantities (:mod:`.quantity`), **Theorem 4** errors of histories (:mod:`.whole_history`).

**The data.** The theorems hold for data that are linear on edges and in cells. For other data, a bound contains an
estimate, which the attribute `kind` of the bound names (:mod:`.reading`).

**In space** there is no bound yet: displacements inside polyhedra are not implemented. The theorems hold in space, and
M. Krizek constructs stresses on split tetrahedra (Apl. Mat. 27 (1982)).
"""
