// A steel bush is pressed into the hole of an aluminium lug. This is the upper half, in mm.
bore = 7; joint = 10; outer = 20; grip = 60;  // radii; the clamped end is at x = -grip
near = 1.2; far = 4;                          // cell sizes; gmsh -clscale 0.5 halves both
Point(1) = {0, 0, 0, near};
Point(2) = {bore, 0, 0, near};   Point(3) = {0, bore, 0, near};   Point(4) = {-bore, 0, 0, near};
Point(5) = {joint, 0, 0, near};  Point(6) = {0, joint, 0, near};  Point(7) = {-joint, 0, 0, near};
Point(8) = {outer, 0, 0, far};   Point(9) = {0, outer, 0, far};
Point(10) = {-grip, outer, 0, far};  Point(11) = {-grip, 0, 0, far};
Circle(1) = {2, 1, 3};  Circle(2) = {3, 1, 4};
Circle(3) = {5, 1, 6};  Circle(4) = {6, 1, 7};
Circle(5) = {8, 1, 9};  Line(6) = {9, 10};  Line(7) = {10, 11};
Line(8) = {11, 7};  Line(9) = {7, 4};  Line(10) = {2, 5};  Line(11) = {5, 8};
Curve Loop(1) = {10, 3, 4, 9, -2, -1};     Plane Surface(1) = {1};
Curve Loop(2) = {11, 5, 6, 7, 8, -4, -3};  Plane Surface(2) = {2};
Physical Curve("bore") = {1, 2};
Physical Curve("joint") = {3, 4};  // one curve, which both surfaces share
Physical Curve("grip") = {7};
Physical Curve("middle") = {8, 9, 10, 11};
Physical Surface("bush") = {1};
Physical Surface("lug") = {2};
Recombine Surface {1, 2};
Mesh.Algorithm = 8;
