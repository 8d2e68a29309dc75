// A ring along z with a round hole across its wall, of tetrahedra: as a bore with an oil
// passage. SI units, the bore's centre at the origin, the hole along y.
SetFactory("OpenCASCADE");

DefineConstant[
  bore_radius = {0.0225, Min 0.01, Max 0.06, Step 1e-4, Name "Ring/bore_radius"}
  bore_width  = {0.0220, Min 0.01, Max 0.06, Step 1e-4, Name "Ring/bore_width"}
  wall        = {0.0100, Min 0.005, Max 0.03, Step 1e-4, Name "Ring/wall"}
  hole_radius = {0.0035, Min 0.001, Max 0.03, Step 1e-4, Name "Ring/hole_radius"}
  hole_height = {0.0010, Min -0.01, Max 0.01, Step 1e-4, Name "Ring/hole_height"}
  size        = {0.0045, Min 1e-3, Max 0.02, Step 1e-4, Name "Ring/size"}
];

Cylinder(1) = {0, 0, -bore_width / 2, 0, 0, bore_width, bore_radius + wall};
Cylinder(2) = {0, 0, -bore_width / 2, 0, 0, bore_width, bore_radius};
BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Cylinder(4) = {0, 0, hole_height, 0, 2 * bore_radius, 0, hole_radius};
BooleanDifference(5) = { Volume{3}; Delete; }{ Volume{4}; Delete; };

eps = 1e-5;
r = bore_radius + eps;
o = bore_radius + wall + eps;
h = hole_radius + eps;
z = bore_width / 2 + eps;
bore() = Surface In BoundingBox{-r, -r, -z, r, r, z};
ends() = Surface In BoundingBox{-o, -o, -z, o, o, -z + 2 * eps};
ends() += Surface In BoundingBox{-o, -o, z - 2 * eps, o, o, z};
passage() = Surface In BoundingBox{-h, 0, hole_height - h, h, o, hole_height + h};
outside() = Surface In BoundingBox{-o, -o, -z, o, o, z};
outside() -= {bore(), ends(), passage()};
Physical Volume("ring") = {5};
Physical Surface("bore") = {bore()};
Physical Surface("outside") = {outside()};
Mesh.CharacteristicLengthMin = size;
Mesh.CharacteristicLengthMax = size;
