"""Guaranteed bounds on the error, by admissible stresses and admissible displacements.

C is the elastic tensor, eps(v) the strain of a displacement v, and (., .) the integral of a product over the body. Let
a(v, w) = (C eps(v), eps(w)). A displacement v has the norm |v| = |v|_a = a(v, v)^{1/2}, and a stress tau has the norm
|tau| = (tau, C^-1 tau)^{1/2}.

**The step.** The exact displacement u minimises J(v) = a(v, v) / 2 + (sigma_0, eps(v)) - l(v) + j(v) among the
displacements v that the supports admit. Here sigma_0 is the prestress, and l(v) the work of the loads. The friction
bound is given. The convex function j contains the friction work and the energy of compliant obstacles. j(v) is infinite
if v moves the body into a rigid obstacle. Since u is the minimiser, the stress sigma = sigma_0 + C eps(u) satisfies

    (sigma, eps(v - u)) - l(v - u) + j(v) - j(u)  >=  0      for all v that the supports admit.                     (1)

**The fields.** Let v be a displacement that the supports admit, with finite j(v). Let q be a friction stress and p a
pressure on the contact boundary. Let the stress tau balance the loads, q and p. For all w that vanish on the supports

    (tau, eps(w))  =  l(w) - int (q w_t + p w_n),                                                                 (2)

with the tangential and outward components w_t and w_n of w. We assume that h(w) := j(w) - int (q w_t + p w_n) is
bounded from below. Let r = tau - sigma_0 - C eps(v), A = |r|, and b = h(v) - inf h >= 0.

**Theorem 1** (Prager and Synge, with friction and contact). For e = u - v

    |e|^2 + (h(u) - inf h)  <=  A |e| + b,        |e|  <=  A / 2 + (A^2 / 4 + b)^{1/2},
    |tau - sigma|^2 + |e|^2  <=  A^2 + 2 b,       J(v) - A^2 / 2 - b  <=  J(u)  <=  J(v).

*Proof.* |e|^2 = (sigma - sigma_0 - C eps(v), eps(e)) <= l(e) + j(v) - j(u) - (sigma_0 + C eps(v), eps(e)) by (1). With
(2) for w = e, l(e) = (tau, eps(e)) + int (q e_t + p e_n), and j(v) - j(u) + int (q e_t + p e_n) = h(v) - h(u). This
proves the first inequality. Since h(u) >= inf h, the second follows from x^2 <= A x + b. Let X = tau - sigma. Then
r = X + C eps(e), and (X, eps(e)) >= h(u) - h(v) >= -b by (1) and (2). So |r|^2 = |X|^2 + |e|^2 + 2 (X, eps(e)) proves
the third. For the fourth, (1) gives J(v) - J(u) >= |e|^2 / 2 >= 0. By (2), J(v) - J(u) = (r, eps(e)) + h(v) - h(u) -
|e|^2 / 2 <= A |e| + b - |e|^2 / 2 <= A^2 / 2 + b.

**Theorem 2** (lower bound). If w vanishes on the supports and where friction or obstacles act, then |e| >= R(w) / |w|
with the residual R(w) = l(w) - (sigma_0 + C eps(v), eps(w)), and J(u) <= J(v) - (R(w) / |w|)^2 / 2. *Proof.* Insert
v = u + w and v = u - w in (1). So (sigma, eps(w)) = l(w) and R(w) = a(e, w). Then minimise J(v + s w) over numbers s.

**Theorem 3** (:mod:`.quantity`) bounds quantities. **Theorem 4** (:mod:`.whole_history`) bounds errors of histories.

**The data.** The theorems hold for data that are linear on edges and in cells. For other data, a bound contains an
estimate (:mod:`.reading`).

**In space** there is no bound yet, because displacements inside polyhedra are not implemented.
"""
