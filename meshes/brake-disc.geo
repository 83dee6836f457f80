// A brake disc on its hub, in metres: gmsh -3 brake-disc.geo
inner = 0.055; outer = 0.15; half = 0.006;
Point(1) = {inner, 0, -half};
Point(2) = {outer, 0, -half};
Line(1) = {1, 2};
Transfinite Curve{1} = 3;                                   // two cells across
line = 1;
For k In {1:3}                                              // a turn in three steps: Gmsh needs less than half a turn each
  made[] = Extrude{{0, 0, 1}, {0, 0, 0}, 2 * Pi / 3}{Curve{line}; Layers{8}; Recombine;};
  line = made[0];
EndFor
Coherence;
Extrude{0, 0, 2 * half}{Surface{:}; Layers{1}; Recombine;}
Coherence;
e = 1e-6;
Physical Volume("disc") = Volume{:};                        // needed: without groups of volumes Gmsh saves no cells
Physical Surface("hub") = Surface In BoundingBox{-inner - e, -inner - e, -1, inner + e, inner + e, 1};
Physical Surface("outboard") = Surface In BoundingBox{-1, -1, half - e, 1, 1, half + e};
Physical Surface("inboard") = Surface In BoundingBox{-1, -1, -half - e, 1, 1, -half + e};
Mesh.ElementOrder = 2;                                      // bricks of 8 nodes would be far too stiff in bending
Mesh.SecondOrderIncomplete = 1;                             // bricks of 20 nodes
