"""Write single_cylinder.csv: load on a main bearing of a single-cylinder four-stroke engine.

It is a formula's; nothing of it is measured. Run it with

    python demos/loads/make_single_cylinder.py


Axes at rest in the engine: x from the crankshaft to the cylinder, y 90 degrees
on in the direction of rotation; crank angle theta = 0 at firing dead centre.
The rod leans by ``sin(beta) = lambda sin(theta)``, ``lambda = r / l``. The piston's

    s'' = -r omega^2 (cos(theta) + (lambda cos(2 theta) + lambda^3 sin(theta)^4) / cos(beta)^3)

and the gas need the force ``S = A (p - p_0) + m_rec s''`` from the rod, so the shaft bears

    F = (-S, S tan(beta)) + m_rot r omega^2 (cos(theta), sin(theta))

and each of its two main bearings half of it. In the cylinder, closed from
-180 to 180 degrees,

    p = p_0 (V_max / V)^n (1 + (a - 1) x_b),    x_b = 1 - exp(-5 (theta - theta_0)^3 / delta^3):

a polytrope, raised by heat released after Wiebe's function (Heywood, Internal
Combustion Engine Fundamentals, chapter 9). The rest escapes exponentially.
The figures below are made up, those of a petrol engine of half a litre: 51 bar, 13
degrees after dead centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

SPEED = 300.0  # rad/s
FILE = Path(__file__).with_name("single_cylinder.csv")

HEADER = f"""\
# Load on one of two main bearings of a single-cylinder four-stroke engine at {SPEED:g} rad/s.
# Computed by demos/loads/make_single_cylinder.py from a formula, not measured.
# x from the crankshaft to the cylinder, y 90 degrees on in the direction of rotation.
time_s,Fx_N,Fy_N"""

#: Rows of the history: one every other degree of two revolutions.
ROWS = 361


@dataclass(frozen=True)
class Engine:
    """Lengths [m], masses [kg], pressures [Pa], angles [degrees].

    `rotating_mass` is what the counterweights leave, at the crank radius;
    `pressure_rise` the factor a of the heat, `burn_start` and `burn_duration`
    the angles theta_0 and delta, `blow_down` that of the escape to 1/e.
    """

    cylinder_bore: float = 0.086
    crank_radius: float = 0.043
    rod_length: float = 0.143
    reciprocating_mass: float = 0.6
    rotating_mass: float = 0.4
    compression_ratio: float = 10.0
    ambient: float = 1e5
    polytropic_exponent: float = 1.32
    pressure_rise: float = 3.8
    burn_start: float = -25.0
    burn_duration: float = 60.0
    blow_down: float = 20.0

    def lean(self, angle: np.ndarray) -> np.ndarray:
        """``sin(beta)`` of the rod."""
        return self.crank_radius / self.rod_length * np.sin(angle)

    def gas_pressure(self, angle: np.ndarray) -> np.ndarray:
        """Pressure over ambient at crank angles in -pi to 3 pi [Pa]."""
        cosine = np.sqrt(1 - self.lean(angle) ** 2)
        # Distance of the piston from its dead centre, over the stroke.
        travel = 0.5 * (1 - np.cos(angle)) + 0.5 * self.rod_length / self.crank_radius * (
            1 - cosine
        )
        swept = self.compression_ratio - 1
        volume = (1 + swept * travel) / self.compression_ratio
        progress = (np.degrees(angle) - self.burn_start) / self.burn_duration
        burnt = 1 - np.exp(-5 * np.clip(progress, 0, None) ** 3)
        rise = 1 + (self.pressure_rise - 1) * burnt
        closed = volume**-self.polytropic_exponent * rise - 1
        escaped = np.exp(-(np.degrees(angle) - 180) / self.blow_down)
        opened = (self.pressure_rise - 1) * escaped
        return self.ambient * np.where(angle < np.pi, closed, opened)


def engine_load(speed: float, engine: Engine | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Times and load on one main bearing at a crank speed [rad/s], from firing dead centre on."""
    engine = engine or Engine()
    angle = np.linspace(0.0, 4 * np.pi, ROWS)
    lean = engine.lean(angle)
    cosine = np.sqrt(1 - lean**2)
    ratio = engine.crank_radius / engine.rod_length
    bracket = ratio * np.cos(2 * angle) + ratio**3 * np.sin(angle) ** 4
    centrifugal = engine.crank_radius * speed**2
    acceleration = -centrifugal * (np.cos(angle) + bracket / cosine**3)
    area = 0.25 * np.pi * engine.cylinder_bore**2
    pressure = engine.gas_pressure(np.where(angle < 3 * np.pi, angle, angle - 4 * np.pi))
    along = area * pressure + engine.reciprocating_mass * acceleration
    rotating = engine.rotating_mass * centrifugal
    forces = np.column_stack(
        [-along + rotating * np.cos(angle), along * lean / cosine + rotating * np.sin(angle)]
    )
    forces[-1] = forces[0]
    return angle / speed, 0.5 * forces


def main(path: Path = FILE) -> Path:
    """Write the file."""
    times, forces = engine_load(SPEED)
    lines = [f"{time:.7e},{x:.3f},{y:.3f}" for time, (x, y) in zip(times, forces, strict=True)]
    path.write_text("\n".join([HEADER, *lines]) + "\n")
    return path


if __name__ == "__main__":
    print(main())
