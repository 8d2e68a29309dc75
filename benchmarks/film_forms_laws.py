"""The film's weak form and its laws in UFL."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import ufl
from film_forms_compat import Coefficient, plane, plane_domain, plane_element, quadrature_element

from fenics_ehd.fem.elements import quadratic_element
from fenics_ehd.film import flow_factors
from fenics_ehd.film.forms import GAUSS_POINTS
from fenics_ehd.film.lubricant import Roelands
from fenics_ehd.film.thinning import LARGEST_RELATIVE_RATE, SMALLEST_RELATIVE_RATE

DEGREE = 2 * GAUSS_POINTS - 1

#: Numbers of the form: entries of one vector-valued constant.
NUMBERS = (
    "clearance", "speed", "rate", "pressure_scale", "viscosity", "density",
    "squeeze", "storage", "rate_shift", "pressure_coefficient", "pressure_index",
    "thinning_rate", "thinning_exponent", "second_viscosity",
    "roughness", "roughness_weight", "least_gap", "least_mobility", "least_power",
)  # fmt: skip

#: Gap data and other values at the Gauss points.
GAP = ("thickness", "thickness_rate", "mean_velocity", "sliding_velocity")

FIELDS = ("viscosity_field", "density_field")
SUPPLIES = ("own", "own_given", "resistive", "resistive_given")
HISTORY = ("history",)

#: H below which h_T is evaluated as a continued fraction, and its levels.
DEEP, LEVELS = -4.0, 10


@dataclass(frozen=True)
class Laws:
    """What a compiled film is made for: an element and a combination of laws."""

    family: str
    viscosity: str = "constant"
    density: str = "constant"
    thinning: bool = False
    surfaces: str = "smooth"
    dragging: bool = False
    fields: bool = False
    supplies: bool = False
    history: bool = False

    @property
    def values(self) -> tuple[str, ...]:
        """Names of all values at the Gauss points."""
        named = GAP
        for asked, names in (
            (self.fields, FIELDS), (self.supplies, SUPPLIES), (self.history, HISTORY)
        ):  # fmt: skip
            named += names if asked else ()
        return named

    @property
    def slides(self) -> bool:
        """Whether anything follows the sliding velocity."""
        return self.thinning or self.dragging


def element_of(family: str) -> Any:
    """Pressure's element."""
    if family == "serendipity":
        return plane(quadratic_element(family, "quadrilateral"))
    return plane_element(1 if family == "bilinear" else 2)


# --- Laws: expressions of a few lines.


def barus(p: Any, n: dict) -> Any:
    """Barus: ``exp(alpha p)``."""
    return ufl.exp(n["pressure_coefficient"] * p)


def roelands(p: Any, n: dict) -> Any:
    """Roelands: ``exp(s ((1 + p / p_0)^Z - 1))``."""
    base = 1 + p / Roelands.REFERENCE
    return ufl.exp(n["pressure_coefficient"] * (base ** n["pressure_index"] - 1))


def dowson_higginson(p: Any, n: dict) -> Any:
    """Dowson and Higginson's density."""
    return 1 + 0.6e-9 * p / (1 + 1.7e-9 * p)


PRESSURE_LAWS = {"barus": barus, "roelands": roelands, "dowson-higginson": dowson_higginson}


def of_pressure(law: str, p: Any, n: dict) -> Any:
    """Ratio to the value at ambient pressure, which counts below it."""
    if law == "constant":
        return 1.0
    return PRESSURE_LAWS[law](ufl.conditional(ufl.ge(p, 0.0), p, 0.0), n)


def cross(rate: Any, n: dict) -> Any:
    """Cross: viscosity over that at rest."""
    relative = rate / n["thinning_rate"]
    relative = ufl.conditional(
        ufl.lt(relative, LARGEST_RELATIVE_RATE), relative, LARGEST_RELATIVE_RATE
    )
    moving = ufl.gt(relative, SMALLEST_RELATIVE_RATE)
    power = ufl.conditional(moving, relative, 1.0) ** n["thinning_exponent"]
    share = 1 / (1 + ufl.conditional(moving, power, 0.0))
    return n["second_viscosity"] + (1 - n["second_viscosity"]) * share


def mean_gap(ratio: Any) -> tuple[Any, Any]:
    """``h_T / sigma`` and its slope: ``H Phi(H) + f(H)`` and ``Phi(H)``.

    Deep below, where the two terms cancel, by the even part of Laplace's continued fraction of
    ``Phi(-x) / f(x)``: exact to 6e-12 at H = -4, 3e-14 at -5.
    """
    density = ufl.exp(-0.5 * ratio * ratio) / math.sqrt(2 * math.pi)
    share = 0.5 * (1 + ufl.erf(ratio / math.sqrt(2)))
    deep = ufl.lt(ratio, DEEP)
    x = -ufl.conditional(deep, ratio, DEEP)
    square, tail = x * x, 0.0
    for k in range(LEVELS, 0, -1):
        tail = 2 * k * (2 * k - 1) / (square + 4 * k + 1 - tail)
    below = density / (square + 1 - tail)
    return (
        ufl.conditional(deep, below * (1 - tail), ratio * share + density),
        ufl.conditional(deep, below * x, share),
    )


def pressure_flow(ratio: Any, average: Any, n: dict) -> Any:
    """``H^3 phi_p``, below what is published the power of h_T that continues it."""
    c, r = flow_factors.PRESSURE
    low = ufl.lt(average, n["least_gap"])
    published = ratio * ratio * ratio * (1 - c * ufl.exp(-r * ratio))
    relative = ufl.conditional(low, average / n["least_gap"], 1.0)
    return ufl.conditional(low, n["least_mobility"] * relative ** n["least_power"], published)


def shear_flow(ratio: Any) -> Any:
    """phi_s."""
    a, power, decay, growth = flow_factors.SHEAR
    open_, above = ufl.gt(ratio, 0.0), ufl.gt(ratio, flow_factors.SHEAR_END)
    inside = ufl.conditional(open_, ufl.conditional(above, flow_factors.SHEAR_END, ratio), 1.0)
    near = a * inside**power * ufl.exp(-decay * inside + growth * inside * inside)
    far = flow_factors.SHEAR_ABOVE * ufl.exp(-0.25 * ratio)
    return ufl.conditional(above, far, ufl.conditional(open_, near, 0.0))


# --- The weak form.


class FilmForms:
    """Residual of (1) and its derivatives, in UFL alone."""

    def __init__(self, laws: Laws):
        self.laws = laws
        domain = plane_domain()
        gauss = ufl.FunctionSpace(domain, quadrature_element(DEGREE))
        nodes = ufl.FunctionSpace(domain, element_of(laws.family))
        constant = ufl.Constant(domain, shape=(len(NUMBERS),))
        n = {name: constant[i] for i, name in enumerate(NUMBERS)}
        self.pressure = Coefficient(nodes)
        values = {name: Coefficient(gauss) for name in laws.values}
        self.coefficients = {"pressure": self.pressure, **values}
        u, v = ufl.TrialFunction(nodes), ufl.TestFunction(nodes)
        dx = ufl.dx(domain, metadata={"quadrature_degree": DEGREE, "quadrature_rule": "default"})
        residual = self._residual(values, n, v) * dx
        w = ufl.TrialFunction(gauss)

        def along(name: str) -> Any:
            return ufl.derivative(residual, values[name], w)

        thickness = along("thickness") + n["rate_shift"] * along("thickness_rate")
        self.forms = {
            "residual": residual,
            "pressure": ufl.derivative(residual, self.pressure, u),
            "thickness": ufl.adjoint(thickness),
            "mean_velocity": ufl.adjoint(along("mean_velocity")),
        }
        if laws.slides:
            self.forms["sliding_velocity"] = ufl.adjoint(along("sliding_velocity"))

    def _residual(self, q: dict, n: dict, v: Any) -> Any:
        laws, P = self.laws, self.pressure
        p = n["pressure_scale"] * P
        viscosity = n["viscosity"] * of_pressure(laws.viscosity, p, n)
        density = n["density"] * of_pressure(laws.density, p, n)
        if laws.fields:
            viscosity, density = viscosity * q["viscosity_field"], density * q["density_field"]
        H, slope = q["thickness"] / n["clearance"], 1
        velocity, sliding = q["mean_velocity"], q["sliding_velocity"]
        mobility = H * H * H
        if laws.surfaces != "smooth":
            ratio = q["thickness"] / n["roughness"]
            average, slope = mean_gap(ratio)
            scale = n["roughness"] / n["clearance"]
            H = scale * average
            mobility = H * H * H
            if laws.surfaces == "factors":
                mobility = scale * scale * scale * pressure_flow(ratio, average, n)
            if laws.dragging:
                drag = 0.5 * n["roughness_weight"] * shear_flow(ratio) / average
                velocity = velocity + sliding * drag
        if laws.thinning:
            speed = ufl.conditional(ufl.lt(sliding, 0.0), -sliding, sliding)
            viscosity = viscosity * cross(speed / (n["clearance"] * H), n)
        conductance = density * mobility / viscosity
        around = conductance * P.dx(0) - density * H * velocity / n["speed"]
        growth = n["squeeze"] * slope * q["thickness_rate"] / n["rate"] + n["storage"] * H
        source = density * growth
        if laws.history:
            source += H * q["history"]
        if laws.supplies:
            cube = H * H * H
            source += (cube * q["own"] + q["resistive"]) * P
            source -= cube * q["own_given"] + q["resistive_given"]
        return around * v.dx(0) + conductance * P.dx(1) * v.dx(1) + source * v
