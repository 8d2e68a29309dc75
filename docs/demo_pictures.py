"""Pictures of the demos' pages: each demo is run, and its result is drawn.

`make pictures` calls this script; the pictures belong to docs/pictures.
"""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import fenics_ehd as ehd
from fenics_ehd.plotting.picture import plt

DOCS = Path(__file__).parent
PICTURES = DOCS / "pictures"

sys.path.insert(0, str(DOCS.parent / "demos"))


def slider_crank() -> Figure:
    """Minimum film thickness of the big end over a turn."""
    return import_module("slider_crank").main().plot("big_end.min_film_thickness")


def loaded_journal() -> Figure:
    """Orbit of the journal over a cycle."""
    return import_module("loaded_journal").main().plot_orbit("film")


def rotor() -> Figure:
    """Orbit of the shaft's journal from rest."""
    return import_module("rotor").main().plot_orbit("bearing")


def rigid_bearing() -> Figure:
    """Load over that of short-bearing theory, over the width of the bearing."""
    demo = import_module("rigid_bearing")
    slenderness = np.geomspace(0.05, 1.0, 12)
    ratios = []
    for each in slenderness:
        settings = ehd.BearingSettings(width=2 * ehd.BearingSettings().radius * each)
        load, _ = demo.ocvirk(settings, 0.5)
        ratios.append(ehd.solve_bearing(settings, eccentricity=0.5).load / load)
    figure, axes = plt.subplots(figsize=(7.2, 4))
    axes.semilogx(slenderness, ratios, "o-")
    axes.set_xlabel("width / diameter")
    axes.set_ylabel("load / load of short-bearing theory")
    axes.grid(alpha=0.4)
    return figure


def foreign_matrices() -> Figure:
    """Nodes of the ring: all, those of the bore, and those of the pin."""
    demo = import_module("foreign_matrices")
    nodes, _, faces = demo.mesh()
    radius = np.hypot(*nodes[:, :2].T)
    angle = np.arctan2(nodes[:, 1], nodes[:, 0])
    pin = (radius > 0.999 * demo.OUTER) & (np.abs(angle) < 0.3)
    figure, axes = plt.subplots(figsize=(4.4, 5))
    parts = {"nodes": slice(None), "bore": np.unique(faces), "pin": pin}
    for (name, part), size in zip(parts.items(), (3, 5, 8), strict=True):
        axes.plot(*1e3 * nodes[part, :2].T, "o", markersize=size, label=name)
    axes.set_aspect("equal")
    axes.set_xlabel("x [mm]")
    axes.set_ylabel("y [mm]")
    figure.legend(loc="upper center", ncols=3)
    return figure


def main(names: list[str]) -> None:
    """Draw the pictures of some demos, or of all."""
    for name in names or PAGES:
        PAGES[name]().savefig(PICTURES / f"demo-{name}.png", dpi=100, bbox_inches="tight")


#: Function that draws the picture of a demo, by the name of the demo.
PAGES = {
    each.__name__: each
    for each in (slider_crank, loaded_journal, rotor, rigid_bearing, foreign_matrices)
}

if __name__ == "__main__":
    main(sys.argv[1:])
