"""Guaranteed bounds on the error: admissible stresses and displacements, and what the skeleton of a mesh bears.

This page states the theorems with their proofs; the modules say how the fields in them are made. Norms of stresses are
in C^-1, those of displacements |v|^2 = a(v, v) = |C eps(v)|^2.

**The step.** u minimises J(v) = a(v, v) / 2 + (sigma_0, eps(v)) - l(v) + j(v) over the displacements that supports
admit, j being convex: friction with a given bound, what obstacles store, and infinite beyond rigid ones, so that sigma
= sigma_0 + C eps(u) satisfies for all of them

    (sigma, eps(v - u)) - l(v - u) + j(v) - j(u)  >=  0.                                                          (1)

**The pair.** v is admissible, j(v) finite; tau is a stress in equilibrium with the loads and with friction q and
pressure p that the laws admit: for all motions w that vanish on supports

    (tau, eps(w))  =  l(w) - int_C q w_t + p w_n,                                                                 (2)

and h(w) := j(w) - int q w_t + p w_n is bounded from below. Let r = tau - sigma_0 - C eps(v), A = |r|, b = h(v) - inf h
>= 0.

**Theorem 1** (Prager and Synge, with friction and contact). For e = u - v

    |e|^2 + (h(u) - inf h)  <=  A |e| + b,        |e|  <=  A / 2 + (A^2 / 4 + b)^{1/2},
    |tau - sigma|^2 + |e|^2  <=  A^2 + 2 b,       J(v) - A^2 / 2 - b  <=  J(u)  <=  J(v).

*Proof.* |e|^2 = (sigma - sigma_0 - C eps(v), eps(e)) <= l(e) + j(v) - j(u) - (sigma_0 + C eps(v), eps(e)) by (1). With
(2) for w = e, l(e) = (tau, eps(e)) + int q e_t + p e_n, and j(v) - j(u) + int q e_t + p e_n = h(v) - h(u). That is the
first line, and its last term is not negative; the second follows from x^2 <= A x + b. For X = tau - sigma, r = X + C
eps(e), and (X, eps(e)) >= h(u) - h(v) >= -b by (1) and (2), so that |r|^2 = |X|^2 + |e|^2 + 2 (X, eps(e)) is the third.
For the fourth, J(v) - J(u) = |e|^2 / 2 + (a number >= 0, by (1)), and by the same steps it is (r, eps(e)) + h(v) - h(u)
- |e|^2 / 2 <= A |e| + b - |e|^2 / 2 <= A^2 / 2 + b.

Without friction and contact the third is an equation: sigma is on the circle over the diameter from sigma_0 + C eps(v)
to tau.

**Theorem 2** (from below). If w vanishes on supports and where friction and obstacles act, then |e| >= (l(w) - (sigma_0
+ C eps(v), eps(w))) / |w|, and J(u) <= J(v) less half the square of that. *Proof.* There (1) holds with both signs for
v = u + w and v = u - w: (sigma, eps(w)) = l(w). So the numerator is a(e, w). The second is the minimum of J(v + s w)
over s.

**Theorem 3** (quantities). With a dual pair z_h, tau_z, a linear q(u) is in an interval of the half width A_z (A^2 / 4
+ b)^{1/2} around a number that both pairs give, provided that z_h vanishes and tau_z has no traction where friction and
obstacles act. Statement and proof: :mod:`.quantity`.

**Theorem 4** (whole histories, of friction with a given bound alone). If data are linear in time between the instants
of the run, and the exact history begins like the run, D_n being what the friction of tau and the slip of v lack of
Tresca's law in a step,

    |tau - sigma|  <=  y_n  =  (y_{n-1}^2 + 2 D_n)^{1/2} + |r_n - r_{n-1}|,    |u - v_n|_a  <=  y_n + |r_n|.

Proof, and what is assumed of the start: :mod:`.whole_history`.

**The data** are theorems' for what is linear on edges and in cells; what else they are is estimated, and `kind` says so
(:mod:`.reading`).

**What sticks for certain: nothing that could be proved.** Theorem 1 with all of its terms says h(u) - inf h <= A^2 / 4
+ b. For friction, h(u) is the integral of g |s| - q s >= (g - |q|) |s|, s being the slip of u: where the friction of
tau stays below its bound by delta, the slip of the exact answer, integrated, is at most (A^2 / 4 + b) / delta. That is
a bound on how much slips. It is none on where: errors in energy bound tractions in the dual norm H^{-1/2} alone, which
admits any value at a point. So no node is called certain to stick or to slip.

**In space** there is no bound yet. The theorems do not ask for the dimension; their fields do. On a tetrahedron split
at its centroid, symmetric stresses that are linear on the four parts have 42 dimensions (M. Krizek, Apl. Mat. 27
(1982)), tractions on faces and divergences determine them, and the hybrid method of :mod:`.equilibrium` goes over with
nine motions a face for four an edge. What is missing is the displacement inside polyhedra: linear ones lock near nu =
1/2, and the degree that does not, on tetrahedra in four parts, is not looked for.
"""
