"""Unit of length that a STEP or IGES file declares.

OpenCASCADE converts the lengths of every file from the declared unit to millimetres. If the
declared unit is wrong, lengths are multiplied by the ratio ``user's unit / declared unit``.
"""

from __future__ import annotations

import re
from pathlib import Path

from fenics_ehd.base.errors import MeshError
from fenics_ehd.base.units import in_unit

#: File name extensions of STEP drawings.
STEP = (".step", ".stp")

#: File name extensions of IGES drawings.
IGES = (".iges", ".igs")

#: Power of ten of each prefix in ISO 10303-41; ``$`` means no prefix.
_PREFIXES = {
    "KILO": 3, "HECTO": 2, "DECA": 1, "$": 0, "DECI": -1, "CENTI": -2, "MILLI": -3, "MICRO": -6,
    "NANO": -9,
}  # fmt: skip

#: Length units of IGES by their flag in the global section [m]. Flag 3, a unit by name, is missing.
_FLAGS = {
    1: 0.0254, 2: 1e-3, 4: 0.3048, 5: 1609.344, 6: 1.0, 7: 1e3, 8: 2.54e-5, 9: 1e-6, 10: 1e-2,
    11: 2.54e-8,
}  # fmt: skip

#: Index of the unit flag among the parameters of the global section of IGES.
_FLAG = 13


def unit_ratio(path: Path, unit: str) -> float:
    """Ratio of a unit of length, such as ``"m"``, to the unit that a drawing declares.

    Raises
    ------
    MeshError
        If the drawing declares no unit of length or several.
    """
    text = path.read_text(encoding="latin-1")
    declared = _iges_unit(text) if path.suffix.lower() in IGES else _step_unit(text)
    if declared is None:
        raise MeshError(
            f"{path} declares no unit of length, or several, so that --unit {unit} has nothing to "
            "replace: omit the option, or export the part again"
        )
    return in_unit(f"1 {unit}", "m") / declared


def _step_unit(text: str) -> float | None:
    """Length of the unit of a STEP file [m]; None if no unit is declared, or several are."""
    contexts = re.findall(r"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)", text)
    numbers = {number for context in contexts for number in re.findall(r"#\s*(\d+)", context)}
    lengths = {_step_length(text, number, 3) for number in numbers} - {None}
    return lengths.pop() if len(lengths) == 1 else None


def _step_length(text: str, number: str, depth: int) -> float | None:
    """Length of the unit that an entity of a STEP file defines [m]; None for other entities.

    Units may be defined by other units, at most `depth` times.
    """
    entity = re.search(rf"#\s*{number}\s*=([^;]*);", text)
    if entity is None or "LENGTH_UNIT" not in entity[1]:
        return None
    if metres := re.search(r"SI_UNIT\s*\(\s*\.?([A-Z$]+)\.?\s*,\s*\.METRE\.", entity[1]):
        power = _PREFIXES.get(metres[1])
        return None if power is None else float(f"1e{power}")
    measure = re.search(r"CONVERSION_BASED_UNIT\s*\([^#;]*#\s*(\d+)", entity[1])
    if measure is None or not depth:
        return None
    factor = re.search(
        rf"#\s*{measure[1]}\s*=[^;]*MEASURE\s*\(\s*([-+.\dEe]+)\s*\)\s*,\s*#\s*(\d+)", text
    )
    base = None if factor is None else _step_length(text, factor[2], depth - 1)
    return None if factor is None or base is None else float(factor[1]) * base


def _iges_unit(text: str) -> float | None:
    """Length of the unit of an IGES file [m]; None if the flag is missing or unknown."""
    rows = [line for line in text.splitlines() if line[72:73] == "G"]
    parameters = _hollerith("".join(line[:72] for line in rows))
    flag = parameters[_FLAG].strip() if len(parameters) > _FLAG else ""
    return _FLAGS.get(int(flag)) if flag.isdigit() else None


def _hollerith(text: str) -> list[str]:
    """Split the text of a section of an IGES file into its parameters.

    A string begins with its number of characters and H, as in ``2HMM``, and may contain delimiters.
    """
    delimiters = ",;"
    delimited = re.match(r"\s*1H(.)(.)\s*(?:1H(.))?", text)
    if delimited is not None and delimited[1] != ",":
        delimiters = delimited[1] + (delimited[3] or ";")
    parameters = []
    position = 0
    token = re.compile(rf"\s*(?:(\d+)H|([^{re.escape(delimiters)}]*))")
    while position < len(text):
        match = token.match(text, position)
        assert match is not None  # the second branch matches any text
        end = match.end() + int(match[1] or 0)
        parameters.append(text[match.end() : end] if match[1] else match[2])
        position = end + 1
    return parameters
