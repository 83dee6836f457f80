// The outboard pad, in metres: a lining on a back plate; gmsh -3 brake-pad.geo
inner = 0.095; outer = 0.145; disc = 0.006; lining = 0.010; plate = 0.006; turn = 50 * Pi / 180;
Point(1) = {inner * Cos(turn / 2), -inner * Sin(turn / 2), disc};
Point(2) = {outer * Cos(turn / 2), -outer * Sin(turn / 2), disc};
Line(1) = {1, 2};
Transfinite Curve{1} = 3;
face[] = Extrude{{0, 0, 1}, {0, 0, 0}, turn}{Curve{1}; Layers{6}; Recombine;};
soft[] = Extrude{0, 0, lining}{Surface{face[1]}; Layers{1}; Recombine;};
hard[] = Extrude{0, 0, plate}{Surface{soft[0]}; Layers{1}; Recombine;};
Physical Volume("lining") = soft[1];
Physical Volume("plate") = hard[1];
Physical Surface("face") = face[1];
Physical Surface("back") = hard[0];
Physical Surface("leading") = hard[2];
Physical Surface("trailing") = hard[4];
Mesh.ElementOrder = 2;
Mesh.SecondOrderIncomplete = 1;
