"""What ``fenics-ehd bearing --help`` says before the options: angles, signs, conventions."""

DRAWING = r"""  maximum film    . . . . .
              .               .             O    centre of the bore
           .                     .          S    centre of the shaft
         .           o o o o       .        x    load line: W acts on the shaft
       .         o             o     .      y    a quarter turn on
      .        o                 o    .          in direction of rotation
      .       o                   o   .
      .       o      O------------------> y      The shaft turns from x to y,
      .       o      | \          o   .          here counter-clockwise.
       .       o     |   S       o   .
         .       o   |         o   .        phi    attitude angle, from x to the
           .       o | o o o o   .                 line of centres OS
              .      |        .             theta  from the maximum film, in
                  . .|. . .   minimum film         direction of rotation
                     v
                     x"""

DESCRIPTION = f"""Operating point of one rigid bearing, at a given eccentricity or load.

\b
{DRAWING}

The load acts on the shaft along x and is balanced by the pressure of the film on it; y
lies a quarter turn on in direction of rotation, z along the axis so that the shaft
turns in the positive sense. With a negative speed this frame turns over, so that
the figures of a bearing do not depend on the sense of rotation. All angles on the
command line and in the results are in degrees, tilts in radians.

The oil cavitates where its pressure would fall below zero (Reynolds condition: p and dp/dn
vanish at the edge of the film). load_N is the resultant of the pressure; the shear force,
smaller by clearance / radius, counts in friction and power only. The gap keeps the
curvature term e_t^2 / 2R that classical tables leave out: up to clearance / radius in load.
The friction torque is that on the shaft, positive when it brakes. In the cavitated zone the
oil fills h_rupture / h of the width (--shear-rule streamers), all of it (full) or
nothing (none); grooves are deep, without friction. The power loss is what shaft and
bore put into the film. The side flow leaves through both sides; that of a groove under pressure
grows slowly with the cells, for the pressure jumps where it meets the side.

A bore that is not round (--ovality and the options after it) stands still in this frame, as
grooves do; its deviations are positive outward, where they open the gap. A misaligned bore is a
tilted shaft with the opposite tilt.

The Sommerfeld number is eta N / p (R / c)^2 with N in revolutions per second and
p = W / (2 R B). The coefficients are k_ij = -dF_i / dx_j and b_ij = -dF_i / dv_j of the film
force F on the shaft. stability_threshold is omega sqrt(c M / W) with the critical mass M of a
rigid rotor, in other words omega_th sqrt(c / g) of a rotor whose weight is the load; null when
it is stable at every speed. With --line-at-max-film the line without pressure turns with the
eccentricity as the shaft moves, or stays where it is, as in a bearing with a groove there
(--line-held): at eccentricity 0.1 that changes the stiffness by 14 %, at 0.6 by 1 %, damping not.
"""
