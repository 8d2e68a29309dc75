// Connecting rod: a planar profile in x, y extruded along z by the bore width,
// in blocks of hexahedra or, with tetrahedra = 1, as one unstructured volume.
// SI units. Bore centre at the origin, pin centre on the x axis, mid-plane of the
// bore at z = 0.
//
// The defaults give, at 7850 kg/m3: mass 0.9728 kg, centre of mass x = 0.06776 m
// (prescribed: 0.973 kg, 0.0677 m), polar inertia about it, z axis, 3.943e-3 kg m2
// (sought: 4e-3). The inertia grows as mass moves from the shank to the two ends,
// hence the heavy small end and the parallel shank; reaching 4e-3 would need a
// shank narrowing towards the big end.

DefineConstant[
  bore_radius       = {0.0225, Min 0.010,  Max 0.250, Step 1e-4, Name "Rod/bore_radius",       Label "Bore radius [m]"}
  bore_width        = {0.0220, Min 0.008,  Max 0.500, Step 1e-4, Name "Rod/bore_width",        Label "Bore width = rod thickness [m]"}
  rod_length        = {0.1600, Min 0.090,  Max 4.000, Step 1e-3, Name "Rod/rod_length",        Label "Bore centre to pin centre [m]"}
  big_end_wall      = {0.0114, Min 0.005,  Max 0.200, Step 1e-4, Name "Rod/big_end_wall",      Label "Radial wall of the big end [m]"}
  pin_radius        = {0.0120, Min 0.005,  Max 0.200, Step 1e-4, Name "Rod/pin_radius",        Label "Pin bore radius [m]"}
  small_end_wall    = {0.0090, Min 0.003,  Max 0.150, Step 1e-4, Name "Rod/small_end_wall",    Label "Radial wall of the small end [m]"}
  shank_width_big   = {0.0250, Min 0.010,  Max 0.500, Step 1e-4, Name "Rod/shank_width_big",   Label "Shank width at the big end [m]"}
  shank_width_small = {0.0250, Min 0.010,  Max 0.500, Step 1e-4, Name "Rod/shank_width_small", Label "Shank width at the small end [m]"}
];

DefineConstant[
  bore_cells_around = {20, Min 10, Max 80, Step 10, Name "Rod/bore_cells_around", Label "Cells around the bore (multiple of 10)"}
  bore_cells_along  = { 5, Min  1, Max 100, Step 1, Name "Rod/bore_cells_along",  Label "Cells along the bore width"}
  big_end_layers    = { 2, Min  1, Max 100, Step 1, Name "Rod/big_end_layers",    Label "Cells through the big-end wall"}
  shank_cells       = {12, Min  2, Max 400, Step 1, Name "Rod/shank_cells",       Label "Cells along the shank"}
  small_end_layers  = { 2, Min  1, Max 100, Step 1, Name "Rod/small_end_layers",  Label "Cells through the small-end wall"}
  tetrahedra        = { 0, Choices{0, 1},          Name "Rod/tetrahedra",        Label "Tetrahedra instead of hexahedra"}
];

// A fifth of the bore cells, those at -36..36 degrees, continue across the shank;
// the rest is shared by two equal blocks that meet behind the bore. The mesh is
// symmetric about y = 0, with a cell boundary there: the film mesh starts there too.
// The pin bore follows: about a quarter of its cells face the shank.
cells_across = Floor(bore_cells_around / 5);

If(10 * Floor(bore_cells_around / 10) != bore_cells_around)
  Error("bore_cells_around = %g is not a multiple of 10: a cell boundary must lie at angle zero", bore_cells_around);
  Abort;
EndIf
counts[] = {bore_cells_along, big_end_layers, shank_cells, small_end_layers};
For c In {0:3}
  If(counts[c] < 1 || counts[c] != Floor(counts[c]))
    Error("number of cells %g (along, big_end_layers, shank_cells, small_end_layers) is not a whole number above 0", counts[c]);
    Abort;
  EndIf
EndFor

// Index 0 is the big end, 1 the small end.
centre_x[]     = {0, rod_length};
inner_radius[] = {bore_radius, pin_radius};
outer_radius[] = {bore_radius + big_end_wall, pin_radius + small_end_wall};
shank_width[]  = {shank_width_big, shank_width_small};
side_cells[]   = {2 * cells_across, Round(1.5 * cells_across)};
layers[]       = {big_end_layers, small_end_layers};
rim[]          = {};

For e In {0:1}
  If(shank_width[e] >= 2 * outer_radius[e])
    Error("the shank, %g wide, does not fit on an end of radius %g", shank_width[e], outer_radius[e]);
    Abort;
  EndIf
EndFor
If(outer_radius[0] + outer_radius[1] >= rod_length)
  Error("the two ends overlap at rod_length = %g", rod_length);
  Abort;
EndIf

// Each end is a ring of three blocks between three spokes. Spokes 0 and 1 bound
// the block facing the shank, spoke 2 lies on the x axis behind the bore. The
// inner angle makes all cells of the bore equal, the outer one fits the shank.
// The small end is the same ring turned by half a turn.
For e In {0:1}
  turn = 1 - 2 * e;
  arc_cells[] = {cells_across, side_cells[e], side_cells[e]};
  inner_angle = Pi * cells_across / (cells_across + 2 * side_cells[e]);
  outer_angle = Asin(shank_width[e] / 2 / outer_radius[e]);
  inner_spoke[] = {-inner_angle, inner_angle, Pi};
  outer_spoke[] = {-outer_angle, outer_angle, Pi};

  centre = newp;
  Point(centre) = {centre_x[e], 0, -bore_width / 2};
  For i In {0:2}
    inner[i] = newp;
    Point(inner[i]) = {centre_x[e] + turn * inner_radius[e] * Cos(inner_spoke[i]), turn * inner_radius[e] * Sin(inner_spoke[i]), -bore_width / 2};
    outer[i] = newp;
    Point(outer[i]) = {centre_x[e] + turn * outer_radius[e] * Cos(outer_spoke[i]), turn * outer_radius[e] * Sin(outer_spoke[i]), -bore_width / 2};
    If(!tetrahedra)
      spoke[i] = newl;
      Line(spoke[i]) = {inner[i], outer[i]};
      Transfinite Curve {spoke[i]} = layers[e] + 1;
    EndIf
  EndFor

  For i In {0:2}
    next = (i + 1) % 3;
    inner_arc[i] = newl;
    Circle(inner_arc[i]) = {inner[i], centre, inner[next]};
    outer_arc[i] = newl;
    Circle(outer_arc[i]) = {outer[i], centre, outer[next]};
    If(!tetrahedra)
      Transfinite Curve {inner_arc[i], outer_arc[i]} = arc_cells[i] + 1;
      loop = newll;
      Curve Loop(loop) = {inner_arc[i], spoke[next], -outer_arc[i], -spoke[i]};
      blocks[3 * e + i] = news;
      Plane Surface(blocks[3 * e + i]) = {loop};
    EndIf
  EndFor

  hole[e] = newll;
  Curve Loop(hole[e]) = {inner_arc[]};
  rim[]        += {outer_arc[1], outer_arc[2]};
  shank_arc[e]   = outer_arc[0];
  shank_start[e] = outer[0];
  shank_end[e]   = outer[1];
EndFor

For e In {0:1}
  edge[e] = newl;
  Line(edge[e]) = {shank_start[e], shank_end[1 - e]};
EndFor

If(tetrahedra)
  // The profile in one piece: the arcs under the shank are inside it. Of the numbers of
  // cells those of the bore count: a triangle with this edge has as many nodes to an area
  // as the quadrilaterals of bore and pin would have.
  Delete { Curve{shank_arc[]}; }
  outline = newll;
  Curve Loop(outline) = {edge[0], rim[2], rim[3], edge[1], rim[0], rim[1]};
  profile = news;
  Plane Surface(profile) = {outline, hole[0], hole[1]};
  swept[] = Extrude {0, 0, bore_width} { Surface{profile}; };
  // The far face, the volume, then the sides in the order of the loops.
  rod[]  = {swept[1]};
  bore[] = {swept[8], swept[9], swept[10]};
  pin[]  = {swept[11], swept[12], swept[13]};
  For e In {0:1}
    around = 2 * Pi * inner_radius[e] / (cells_across + 2 * side_cells[e]);
    size[e] = 1.16 * Sqrt(around * bore_width / bore_cells_along);
  EndFor
  MeshSize { PointsOf { Volume{rod[]}; } } = size[0];
  MeshSize { PointsOf { Surface{pin[]}; } } = size[1];
Else
  Transfinite Curve {edge[]} = shank_cells + 1;
  loop = newll;
  Curve Loop(loop) = {edge[0], -shank_arc[1], edge[1], -shank_arc[0]};
  blocks[6] = news;
  Plane Surface(blocks[6]) = {loop};

  Transfinite Surface {blocks[]};
  Recombine Surface {blocks[]};

  // Per block, Extrude returns the far face, the volume, then the side faces in
  // the order of the curve loop; in the rings the first of these is the bore.
  swept[] = Extrude {0, 0, bore_width} {
    Surface {blocks[]}; Layers {bore_cells_along}; Recombine;
  };
  For b In {0:6}
    rod[b] = swept[6 * b + 1];
  EndFor
  For i In {0:2}
    bore[i] = swept[6 * i + 2];
    pin[i]  = swept[6 * (3 + i) + 2];
  EndFor
EndIf

Physical Volume("rod", 1)   = {rod[]};
Physical Surface("bore", 2) = {bore[]};
Physical Surface("pin", 3)  = {pin[]};

Mesh.ElementOrder = 2;
