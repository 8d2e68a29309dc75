# # A rigid bearing
#
# Shaft and bore are rigid, and the load is constant: where does the shaft run, and is it stable?
# The pressure solves Reynolds' equation with cavitation on 9-node elements,
#
#     div(h^3 / (12 eta) grad p) = U/2 dh/dx + dh/dt,    p >= 0,
#
# and a bearing much shorter than its diameter has an analytical solution by Ocvirk to compare with.
# Run it with
#
#     python demos/rigid_bearing.py

# +
import attrs
import numpy as np

import fenics_ehd as ehd
from fenics_ehd.analysis.bearing import BearingResult

# -

# ## Operating point
#
# The defaults are the big end of the paper's Table 1: radius 22.5 mm, clearance 17 um, width 22 mm,
# oil of 0.01 Pa s, 500 rad/s. Under 5 kN the shaft sinks into the bore, off the load line: the
# *attitude* is the angle from the load to the line of centres, in direction of rotation.


def operating_point(load: float) -> BearingResult:
    """Print the operating point of the default bearing under a load [N]."""
    found = ehd.solve_bearing(ehd.BearingSettings(), load=load, with_coefficients=True)
    print(f"load {1e-3 * load:g} kN: eccentricity {found.eccentricity_ratio:.4f} of the clearance,")
    print(f"  attitude {np.degrees(found.attitude):.2f} degrees,")
    print(f"  thinnest film {1e6 * found.min_film_thickness:.3f} um,")
    print(f"  highest pressure {1e-6 * found.max_pressure:.2f} MPa,")
    print(f"  power loss {found.power_loss:.0f} W")
    return found


# ## Coefficients
#
# For small motions about this point the film acts as a spring and a damper, with x along the load:
#
#     dF = -k dx - b dx'
#
# k is not symmetric, which makes a lightly loaded shaft whirl: above a certain mass, the
# film drives a rigid rotor into an orbit at about half the shaft's speed.


def coefficients(found: BearingResult) -> None:
    """Print stiffness, damping and the stability threshold."""
    c = found.coefficients
    assert c is not None
    for name, matrix, unit in (("k", c.stiffness, "MN/m"), ("b", 1e3 * c.damping, "kN s/m")):
        (xx, xy), (yx, yy) = 1e-6 * matrix
        print(f"  {name} = [{xx:8.1f} {xy:8.1f}; {yx:8.1f} {yy:8.1f}] {unit}")
    if c.critical_mass is None:
        print("  no whirl at any mass")
    else:
        print(f"  whirl above {c.critical_mass:.0f} kg, at {c.whirl_ratio:.3f} of the speed")


# ## Short-bearing theory
#
# Without flow along the circumference the pressure is a parabola over the width. If its negative
# half is set to zero, load and attitude are
#
#     W = eta omega R B^3 / (4 c^2) eps / (1 - eps^2)^2 sqrt(16 eps^2 + pi^2 (1 - eps^2))
#     tan(attitude) = pi / 4 sqrt(1 - eps^2) / eps


def ocvirk(settings: ehd.BearingSettings, eps: float) -> tuple[float, float]:
    """Ocvirk's load [N] and attitude [rad] of a short bearing at an eccentricity ratio."""
    s, rest = settings, 1 - eps**2
    scale = s.viscosity * s.speed * s.radius * s.width**3 / (4 * s.clearance**2)
    load = scale * eps / rest**2 * np.sqrt(16 * eps**2 + np.pi**2 * rest)
    return load, np.arctan(np.pi / 4 * np.sqrt(rest) / eps)


def shorter_and_shorter(eps: float = 0.5) -> float:
    """Print the load over Ocvirk's for ever shorter bearings; returns that of the shortest."""
    print(f"width / diameter, load / Ocvirk's, attitude - Ocvirk's, at eccentricity {eps:g}:")
    ratio = np.nan
    for slenderness in (1.0, 0.5, 0.25, 0.1, 0.05):
        settings = ehd.BearingSettings()
        settings = attrs.evolve(settings, width=2 * settings.radius * slenderness)
        load, attitude = ocvirk(settings, eps)
        found = ehd.solve_bearing(settings, eccentricity=eps)
        ratio = found.load / load
        difference = np.degrees(found.attitude - attitude)
        print(f"  {slenderness:5.2f} {ratio:8.4f} {difference:8.2f} degrees")
    return ratio


# The theory gives 1.7 times the load for a bearing as wide as its diameter, and has an error of a
# third of a percent for a twentieth of this width.


def main() -> float:
    """Run all parts; returns the load over Ocvirk's of the shortest bearing."""
    for load in (5e3, 200.0):
        coefficients(operating_point(load))
    return shorter_and_shorter()


if __name__ == "__main__":
    main()
