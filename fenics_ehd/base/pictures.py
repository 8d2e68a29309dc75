"""Names of the pictures of runs: what ``fenics-ehd plot`` draws, in which order, in which files."""

#: Quantities; joints, and what several runs make of them, may follow in the name of a file.
PICTURES = (
    "max_pressure",
    "min_film_thickness",
    "orbit",
    "force",
    "eccentricity",
    "places",
    "friction",
    "flow",
    "contact",
    "oil_content",
    "basis_error",
    "error_budget",
    "pressure_map",
    "film_map",
    "contact_map",
    "bore",
    "energy",
)

#: Formats of each of them.
FORMATS = ("png", "svg")
