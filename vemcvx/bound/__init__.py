"""Guaranteed bounds on the error: admissible stresses and displacements, and what the skeleton of a mesh bears.

This page states the theorems with their proofs; the modules say how the fields in them are made. Norms of stresses are
in C^-1, those of displacements |v|^2 = a(v, v) = |C eps(v)|^2.

**The step.** u minimises J(v) = a(v, v) / 2 + (sigma_0, eps(v)) - l(v) + j(v) over the displacements that supports
admit, j being convex: friction with a given bound, what obstacles store, and infinite beyond rigid ones, so that sigma
= sigma_0 + C eps(u) satisfies for all of them

    (sigma, eps(v - u)) - l(v - u) + j(v) - j(u)  >=  0.                                                          (1)

**The pair.** v is admissible, j(v) finite; tau is a stress in equilibrium with linear moments l_1 of the loads and
friction q and pressure p that the laws admit: for all motions w that vanish on supports

    (tau, eps(w))  =  l_1(w) - int_C q w_t + p w_n,                                                               (2)

and h(w) := j(w) - int q w_t + p w_n is bounded from below. Let r = tau - sigma_0 - C eps(v), b = h(v) - inf h >= 0, and
let osc_T be such that (l - l_1)(w) <= sum_K osc_K |w|_K (:mod:`.hypercircle` has these with their constants).

**Theorem 1** (Prager and Synge, with friction, contact and data). For e = u - v and A^2 = sum_K (|r|_K + osc_K)^2

    |e|^2 + (h(u) - inf h)  <=  sum_K (|r|_K + osc_K) |e|_K + b,        |e|  <=  A / 2 + (A^2 / 4 + b)^{1/2},
    J(v) - A^2 / 2 - b  <=  J(u)  <=  J(v).

*Proof.* |e|^2 = (sigma - sigma_0 - C eps(v), eps(e)) <= l(e) + j(v) - j(u) - (sigma_0 + C eps(v), eps(e)) by (1). With
(2) for w = e, l(e) = (l - l_1)(e) + (tau, eps(e)) + int q e_t + p e_n, and j(v) - j(u) + int q e_t + p e_n = h(v) -
h(u). That is the first line, and its last term is not negative; the second follows by Cauchy's inequality, and from x^2
<= A x + b. For the third, J(v) - J(u) = |e|^2 / 2 + (a number >= 0, by (1)), and by the same steps it is (r, eps(e)) +
(l - l_1)(e) + h(v) - h(u) - |e|^2 / 2 <= A |e| + b - |e|^2 / 2 <= A^2 / 2 + b.

Without friction, contact and oscillation it is an equation, |u - v|^2 + |sigma - tau|^2 = |r|^2: sigma is on the circle
over the diameter from sigma_0 + C eps(v) to tau.

**Theorem 2** (from below). If w vanishes on supports and where friction and obstacles act, then |e| >= (l(w) - (sigma_0
+ C eps(v), eps(w))) / |w|, and J(u) <= J(v) less half the square of that. *Proof.* There (1) holds with both signs for
v = u + w and v = u - w: (sigma, eps(w)) = l(w). So the numerator is a(e, w). The second is the minimum of J(v + s w)
over s.

**Theorem 3** (quantities). With a dual pair z_h, tau_z, a linear q(u) is in an interval of the half width A_z R + sum
osc^z_T |r|_T / 2 around a number that both pairs give, R = |osc| / 2 + (A^2 / 4 + b)^{1/2}, provided that z_h vanishes
and tau_z has no traction where friction and obstacles act. Statement and proof: :mod:`.quantity`.

**Theorem 4** (whole histories, of friction with a given bound alone). Along any path of admissible v and tau that is
linear in time between instants, D_n being what the friction of tau and the slip of v lack of Tresca's law there, if
data are linear in time there, too, and the exact history begins like the run, y_0 = |r_0|,

    |tau - sigma|  <=  y_n  =  (y_{n-1}^2 + 2 D_n)^{1/2} + |r_n - r_{n-1}|,    |u - v_n|_a  <=  y_n + |r_n|.

Proof and path: :mod:`.error_bound`, :mod:`.within`; data that are not linear between its instants:
:mod:`.data_in_time`.

**The data** are functions of which a program knows values at points, and the theorems are about data as read there:
body forces at 21 points of each triangle of a fan, tractions at three of each piece of the boundary (1/512 of the size
of the body, or a quarter of an edge), bounds of friction, gaps and motions at the ends of pieces and linear between.
Loads that are polynomials up to degree three on the triangles, or the edges, are read exactly. What is narrower than
the distance of the points may not be seen, be it a load, friction, or a quantity. A second, finer reading tells loads
of other kinds, and bounds are wider by an allowance (:mod:`.reading`).

**What sticks for certain: nothing that could be proved.** Theorem 1 with all of its terms says h(u) - inf h <= A^2 / 4
+ b, the maximum of A x - x^2 being A^2 / 4. For friction, h(u) is the integral of g |s| - q s >= (g - |q|) |s|, s
being the slip of u:

    int_C (g - |q|) |s|  <=  A^2 / 4 + b,

so that where the friction of tau stays below its bound by delta, the slip of the exact answer, integrated, is at most
(A^2 / 4 + b) / delta; likewise friction comes near to its bound, on average, where v slips. That is a bound on how much
slips. It is none on where: a slip as small as one likes on an edge that sticks in the run contradicts no integral. To
exclude it the traction of the exact answer would have to be known pointwise, while errors in energy bound tractions in
the dual norm H^{-1/2} alone, which admits any value at a point. So no node is called certain to stick or to slip.

**In space** there is no bound yet. Theorems 1 to 4 do not ask for the dimension; their fields do. What is known:

- *Stress.* On a tetrahedron split at its centroid, symmetric stresses that are linear on the four parts, with tractions
  that go on across the six inner faces, have 42 dimensions (M. Krizek, Apl. Mat. 27 (1982)). Tractions on
  the four faces, linear there, and the divergences on the parts determine them: 36 + 12 numbers less six of balance.
  Those without divergence have tractions of rank 30 = 36 - 6, and none has neither, so that motions of faces, linear on
  each, nine numbers a face, have no other motions without energy than rigid ones: the hybrid method of
  :mod:`.equilibrium` goes over with nine for four. tau = B tau^ B' / det B maps the tetrahedron of reference.
- *Trial* (outside of the package): cubes cut into six tetrahedra, Clamp, linear tractions, a constant body force, a
  quadratic displacement. |r| over the error of the linear displacement is 1 to 1e-12 on 6, 48 and 384 tetrahedra at
  lambda = 1.5 mu, and on 384 at 1000 mu. The exact stress is among those of the space there, so that this must be: it
  checks the construction, and says nothing of how sharp bounds are where it is not. Symmetry is exact, so that no
  rotation has to be paid for by Korn's constant on stars.
- *Friction* is linear on faces, with |q| <= g at their corners, hence on all of them if g is linear; |s| of a linear
  slip lies below the line between its corners.
- *Polyhedra* that are seen from a point are fans of tetrahedra over fans of their faces.

What is missing: the displacement inside polyhedra (linear ones lock near nu = 1/2; the degree that does not, on
tetrahedra in four parts, is not looked for), and a constant for loads that are not linear. Korn's inequality for it
follows as in :mod:`.body_force`, for the gradient of each rotation is made of derivatives of strains; but beta >= sin(a
/ 4) rests on conjugate harmonic functions, which the plane alone has, and constants by Bogovskii's operator (R. Duran,
Rev. Un. Mat. Argentina 53 (2012)) grow like powers of R / rho; none has been tried. Until then loads would have to be
linear on faces and constant in tetrahedra.
"""
