"""Statements of section 4.2, the slider-crank, and those of section 6 that it can tell."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from fenics_ehd.report.comparisons import m2_ahead_of_m1, many_modes
from fenics_ehd.report.slider_crank_checks import (
    best_at_every_size,
    enough_with_31,
    independent_numbers,
    literal_selection,
    m1_stiff,
    m2_stiff,
    m3_fastest,
    one_shape_is_not_enough,
    quarter_of_m2,
    rich_reference,
    time_grows,
)
from fenics_ehd.report.slider_crank_curves import peak_at_the_axis, plateau, smoother_flank
from fenics_ehd.report.statement import WELL, Finding, Statement
from fenics_ehd.report.study_data import Study

_WELL = f"largest error of both curves at most {100 * WELL:.0f} %"
_TWICE = "at least twice as many coordinates as M3 for 5 % in both curves"
_STIFF = "mean error positive where the reference is above 75 % of its peak"
_SMALLER = "smaller errors of both curves with equally many coordinates"


def _statement(place: str, says: str, rule: str, check: Callable[[Study], Finding]) -> Statement:
    return Statement(place, says, rule, "slider-crank", check)


STATEMENTS = (
    _statement(
        "4.2, fig. 5",
        "M3 with unit pressures, 60 residual and 6 vibration modes can serve as the reference",
        _WELL,
        rich_reference,
    ),
    _statement(
        "4.2, fig. 5",
        "between 6 and 8 ms the peak pressure hardly changes while the film gets thinner",
        "pressure within 10 %, film falling, by 10 % at least",
        plateau,
    ),
    _statement(
        "4.2, fig. 5",
        "the pressure then peaks at about phi = 0",
        "within 15 degrees",
        peak_at_the_axis,
    ),
    _statement(
        "4.2, fig. 5",
        "meanwhile the pressure falls less sharply in the widening gap",
        "at mid-width, half the peak lies 10 % farther behind it at the end",
        smoother_flank,
    ),
    _statement("4.2, fig. 6", "M1 needs many modes", _TWICE, partial(many_modes, method="m1")),
    _statement("4.2, fig. 6", "M1 puts the pressure too high at high loads", _STIFF, m1_stiff),
    _statement("4.2, fig. 7", "M2 needs fewer modes than M1", _SMALLER, m2_ahead_of_m1),
    _statement(
        "4.2, fig. 7", "M2 still needs many modes", _TWICE, partial(many_modes, method="m2")
    ),
    _statement(
        "4.2, fig. 7", "even with 127 modes M2 is too stiff at high pressures", _STIFF, m2_stiff
    ),
    _statement(
        "4.2, fig. 8",
        "with long and short bearing shapes 31 residual modes are enough",
        f"{_WELL}, by one of the selections",
        enough_with_31,
    ),
    _statement(
        "(31)-(32)",
        "the residual modes to keep are those of the smallest eigenvalues",
        "no worse than 5 %, or than the other selections",
        literal_selection,
    ),
    _statement(
        "4.2",
        "M3 needs less than a quarter of M2's modes",
        "coordinates of M2 that give the error of M3 with 31 residual modes, over M3's",
        quarter_of_m2,
    ),
    _statement(
        "4.2",
        "long or short bearing shapes alone do not lead to the reference",
        "either kind: above 5 %, and twice the error of both kinds with no more modes",
        one_shape_is_not_enough,
    ),
    _statement(
        "4.2",
        "the computing time depends strongly on the number of modes",
        "rank correlation above 0.7, half as much time again with the most coordinates",
        time_grows,
    ),
    _statement(
        "4.2",
        "M3 takes less time than M1 and M2 for the same accuracy",
        "for each run of theirs a run of M3 that is no worse and faster, by 30 % at least",
        m3_fastest,
    ),
    _statement("6", "M2 follows the interface better than M1", _SMALLER, m2_ahead_of_m1),
    _statement(
        "6",
        "the load-dependent reduction M3 gives the best results of the three",
        f"{_SMALLER}, wherever all three were run",
        best_at_every_size,
    ),
    _statement(
        "6",
        "analytic pressure shapes serve well where the shaft turns about one axis only",
        _WELL,
        enough_with_31,
    ),
    _statement(
        "6",
        "interface modes can be chosen without touching the vibration modes",
        "bodies with different numbers of residual modes have the same vibration frequencies",
        independent_numbers,
    ),
)
