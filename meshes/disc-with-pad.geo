SetFactory("OpenCASCADE");
Cylinder(1) = {0, 0, 0, 0, 0, 0.012, 0.15};               // the disc, in metres
Cylinder(2) = {0, 0, 0, 0, 0, 0.012, 0.05};               // its hole
BooleanDifference(3) = {Volume{1}; Delete;}{Volume{2}; Delete;};
Rectangle(100) = {0.09, -0.02, 0.012, 0.04, 0.04};        // where the pad rubs, on the upper face
BooleanFragments{Volume{3}; Delete;}{Surface{100}; Delete;}
Physical Volume("disc") = Volume{:};                       // needed: without groups of volumes Gmsh saves no cells
Physical Surface("inner") = Surface In BoundingBox{-0.051, -0.051, -0.001, 0.051, 0.051, 0.013};
Physical Surface("pad") = Surface In BoundingBox{0.089, -0.021, 0.011, 0.131, 0.021, 0.013};
Mesh.MeshSizeMax = 0.02;
Mesh.ElementOrder = 2;
