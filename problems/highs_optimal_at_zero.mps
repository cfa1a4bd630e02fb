* minimise d1^2 - d1 d2 + d2^2 - 3 d1 - d2 / 2 + t1 + t2   subject to   -t <= d <= t,   d and t free
* Strictly convex in d, and t >= |d|: the one solution is d = t = (7/6, 1/3), of value -13/12.
NAME optimal_at_zero
ROWS
 N cost
 L U1
 L U2
 L L1
 L L2
COLUMNS
 d1 cost -3
 d1 U1 1
 d1 L1 -1
 d2 cost -0.5
 d2 U2 1
 d2 L2 -1
 t1 cost 1
 t1 U1 -1
 t1 L1 -1
 t2 cost 1
 t2 U2 -1
 t2 L2 -1
RHS
BOUNDS
 FR bound d1
 FR bound d2
 FR bound t1
 FR bound t2
QUADOBJ
 d1 d1 2
 d1 d2 -1
 d2 d2 2
ENDATA
