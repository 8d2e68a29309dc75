// Bearing housing: a ring with the bore on a web and a foot, a planar profile in
// x, y extruded along z by the bore width, in blocks of hexahedra or, with
// tetrahedra = 1, as one unstructured volume. SI units. Bore centre at the origin,
// mid-plane of the bore at z = 0, sole of the foot at y = -centre_height, where the
// housing is held.
//
// The defaults give 20 x 5 cells on the bore and 2977 nodes, 8931 degrees of freedom
// with the 20-node element: the number of the paper, which does not show the shape.
// At 7850 kg/m3 the mass is 0.760 kg.

DefineConstant[
  bore_radius    = {0.0225, Min 0.010, Max 0.250, Step 1e-4, Name "Housing/bore_radius",    Label "Bore radius [m]"}
  bore_width     = {0.0220, Min 0.008, Max 0.500, Step 1e-4, Name "Housing/bore_width",     Label "Bore width = housing thickness [m]"}
  wall           = {0.0100, Min 0.003, Max 0.250, Step 1e-4, Name "Housing/wall",           Label "Radial wall of the ring [m]"}
  centre_height  = {0.0600, Min 0.030, Max 1.500, Step 1e-3, Name "Housing/centre_height",  Label "Bore centre above the sole [m]"}
  web_width      = {0.0800, Min 0.030, Max 1.500, Step 1e-3, Name "Housing/web_width",      Label "Web width at the foot [m]"}
  foot_width     = {0.1040, Min 0.040, Max 2.500, Step 1e-3, Name "Housing/foot_width",     Label "Foot width [m]"}
  foot_thickness = {0.0120, Min 0.003, Max 0.400, Step 1e-4, Name "Housing/foot_thickness", Label "Foot thickness [m]"}
];

DefineConstant[
  bore_cells_around = {20, Min 10, Max 80, Step 10, Name "Housing/bore_cells_around", Label "Cells around the bore (multiple of 10)"}
  bore_cells_along  = { 5, Min  1, Max 40, Step 1,  Name "Housing/bore_cells_along",  Label "Cells along the bore width"}
  ring_layers       = { 3, Min  1, Max 10, Step 1,  Name "Housing/ring_layers",       Label "Cells through the ring"}
  web_layers        = { 4, Min  1, Max 20, Step 1,  Name "Housing/web_layers",        Label "Cells along the web's height"}
  foot_layers       = { 3, Min  1, Max 10, Step 1,  Name "Housing/foot_layers",       Label "Cells through the foot"}
  foot_cells        = { 1, Min  1, Max 20, Step 1,  Name "Housing/foot_cells",        Label "Cells along the foot on either side of the web"}
  tetrahedra        = { 0, Choices{0, 1},           Name "Housing/tetrahedra",        Label "Tetrahedra instead of hexahedra"}
];

If(10 * Floor(bore_cells_around / 10) != bore_cells_around)
  Error("bore_cells_around = %g is not a multiple of 10: a cell boundary must lie at angle zero", bore_cells_around);
  Abort;
EndIf
counts[] = {bore_cells_along, ring_layers, web_layers, foot_layers, foot_cells};
For c In {0:4}
  If(counts[c] < 1 || counts[c] != Floor(counts[c]))
    Error("number of cells %g (along, ring, web, foot layers, foot_cells) is not a whole number above 0", counts[c]);
    Abort;
  EndIf
EndFor

outer_radius = bore_radius + wall;
If(centre_height - foot_thickness <= outer_radius)
  Error("the ring, of radius %g, reaches into the foot: raise centre_height", outer_radius);
  Abort;
EndIf
If(foot_width <= web_width)
  Error("foot_width = %g must be above web_width", foot_width);
  Abort;
EndIf

// The ring: four blocks between spokes at -144, -36, 36 and 144 degrees. The first,
// three tenths of the cells, stands on the web. All cells of the bore are equal, with
// a boundary at angle zero, where the film mesh starts too.
spoke_angle[] = {-0.8 * Pi, -0.2 * Pi, 0.2 * Pi, 0.8 * Pi};
arc_cells[]   = {0.3 * bore_cells_around, 0.2 * bore_cells_around, 0.3 * bore_cells_around, 0.2 * bore_cells_around};
z = -bore_width / 2;

centre = newp;
Point(centre) = {0, 0, z};
For i In {0:3}
  inner[i] = newp;
  Point(inner[i]) = {bore_radius * Cos(spoke_angle[i]), bore_radius * Sin(spoke_angle[i]), z};
  outer[i] = newp;
  Point(outer[i]) = {outer_radius * Cos(spoke_angle[i]), outer_radius * Sin(spoke_angle[i]), z};
  If(!tetrahedra)
    spoke[i] = newl;
    Line(spoke[i]) = {inner[i], outer[i]};
    Transfinite Curve {spoke[i]} = ring_layers + 1;
  EndIf
EndFor
For i In {0:3}
  next = (i + 1) % 4;
  inner_arc[i] = newl;
  Circle(inner_arc[i]) = {inner[i], centre, inner[next]};
  outer_arc[i] = newl;
  Circle(outer_arc[i]) = {outer[i], centre, outer[next]};
  If(!tetrahedra)
    Transfinite Curve {inner_arc[i], outer_arc[i]} = Round(arc_cells[i]) + 1;
    loop = newll;
    Curve Loop(loop) = {inner_arc[i], spoke[next], -outer_arc[i], -spoke[i]};
    blocks[i] = news;
    Plane Surface(blocks[i]) = {loop};
  EndIf
EndFor

// The foot: three blocks side by side, the middle one under the web.
foot_x[]      = {-foot_width / 2, -web_width / 2, web_width / 2, foot_width / 2};
foot_across[] = {foot_cells, arc_cells[0], foot_cells};
For i In {0:3}
  sole[i] = newp;
  Point(sole[i]) = {foot_x[i], -centre_height, z};
  instep[i] = newp;
  Point(instep[i]) = {foot_x[i], foot_thickness - centre_height, z};
EndFor
For i In {0:3}
  // The inner ones would cut the foot in three.
  If(!tetrahedra || i == 0 || i == 3)
    side[i] = newl;
    Line(side[i]) = {sole[i], instep[i]};
  EndIf
  If(!tetrahedra)
    Transfinite Curve {side[i]} = foot_layers + 1;
  EndIf
EndFor
For i In {0:2}
  sole_line[i] = newl;
  Line(sole_line[i]) = {sole[i], sole[i + 1]};
  If(!tetrahedra || i != 1)
    instep_line[i] = newl;
    Line(instep_line[i]) = {instep[i], instep[i + 1]};
  EndIf
  If(!tetrahedra)
    Transfinite Curve {sole_line[i], instep_line[i]} = Round(foot_across[i]) + 1;
    loop = newll;
    Curve Loop(loop) = {sole_line[i], side[i + 1], -instep_line[i], -side[i]};
    blocks[4 + i] = news;
    Plane Surface(blocks[4 + i]) = {loop};
  EndIf
EndFor

// The web, from the foot to the lowest arc of the ring.
For i In {0:1}
  flank[i] = newl;
  Line(flank[i]) = {instep[i + 1], outer[i]};
  If(!tetrahedra)
    Transfinite Curve {flank[i]} = web_layers + 1;
  EndIf
EndFor

If(tetrahedra)
  // The profile in one piece: the arc on the web is inside it. Of the numbers of cells
  // those of the bore count: a triangle with this edge has as many nodes to an area as
  // the quadrilaterals of the bore would have.
  Delete { Curve{outer_arc[0]}; }
  outline = newll;
  Curve Loop(outline) = {
    sole_line[], side[3], -instep_line[2], flank[1], outer_arc[1], outer_arc[2], outer_arc[3],
    -flank[0], -instep_line[0], -side[0]
  };
  hole = newll;
  Curve Loop(hole) = {inner_arc[]};
  profile = news;
  Plane Surface(profile) = {outline, hole};
  swept[] = Extrude {0, 0, bore_width} { Surface{profile}; };
  // The far face, the volume, then the sides in the order of the loops.
  housing[] = {swept[1]};
  foot[]    = {swept[2], swept[3], swept[4]};
  bore[]    = {swept[14], swept[15], swept[16], swept[17]};
  MeshSize { PointsOf { Volume{housing[]}; } } =
    1.16 * Sqrt(2 * Pi * bore_radius / bore_cells_around * bore_width / bore_cells_along);
Else
  loop = newll;
  Curve Loop(loop) = {instep_line[1], flank[1], -outer_arc[0], -flank[0]};
  blocks[7] = news;
  Plane Surface(blocks[7]) = {loop};

  Transfinite Surface {blocks[]};
  Recombine Surface {blocks[]};

  // Per block, Extrude returns the far face, the volume, then the side faces in the order
  // of the curve loop; the first of these is the bore in the ring, the sole in the foot.
  swept[] = Extrude {0, 0, bore_width} {
    Surface {blocks[]}; Layers {bore_cells_along}; Recombine;
  };
  For b In {0:7}
    housing[b] = swept[6 * b + 1];
  EndFor
  For i In {0:3}
    bore[i] = swept[6 * i + 2];
  EndFor
  For i In {0:2}
    foot[i] = swept[6 * (4 + i) + 2];
  EndFor
EndIf

Physical Volume("housing", 1) = {housing[]};
Physical Surface("bore", 2)   = {bore[]};
Physical Surface("foot", 3)   = {foot[]};

Mesh.ElementOrder = 2;
