"""Malformed scenes, tables and options."""

import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from random import Random
from typing import Any

from cases import Case
from scene_cases import ROD_OF_A_FILE, Raw, tables_of, toml
from world import CALLS, COARSE, TABLES, World, command

SCENES = ("slider-crank-paper", "rotor-paper", "loaded-journal", "four-bar")

#: Values of which none belongs to a key that holds this type.
WRONG_VALUES = {
    float: ['"text"', '""', "true", "[]", "{}", "nan", "inf", "-inf", "1979-05-27", "[1.0]",
            "1e999", "9" * 400, "9" * 5000],
    int: ['"3"', '"3 mm"', '"\u0663"', "true", "[]", "{}", "nan", "inf", "1.5", "-1", "[3]",
          "-" + "9" * 400],
    bool: ['"true"', "1", "0.0", "[]", "{}", "[true]"],
    str: ["1", "true", "[]", "{}", "nan", '"no such thing"', '"a\\u0000b"', f'"{"x" * 200_000}"'],
    list: ["1", '"20x5"', '"10 mm"', "true", "[nan, 5]", "[20, 5, 3]", "[[20, 5]]", "[1e999, 1]",
            '["20", "5"]', "{}"],
    dict: ["1", '"text"', "[]", "true"],
}  # fmt: skip

#: Numbers at the ends of what can be written, for keys that do not say how long a run is.
EXTREME = ["1e308", "-1e308", "1e-308", "5e-324", "0", "-0.0", "-1", "1e30", "1e-30"]
MEASURES = (
    "drives.crank.speed",
    "bodies.piston.mass",
    "bodies.crank.mass",
    "bodies.crank.inertia",
    "bodies.crank.points.pin",
    "bodies.rod.damping_time",
    "bodies.rod.mass",
    "bodies.rod.position",
    "joints.big_end.clearance",
    "joints.big_end.smallest_film",
    "joints.big_end.eccentricity",
    "joints.big_end.eccentricity_rate",
    "joints.cylinder.direction",
    "lubricants.oil.viscosity",
)
OF_THE_MODEL = ("bodies.rod.material.youngs_modulus", "bodies.rod.material.density")
PAIRS = ("pin", "position", "eccentricity", "eccentricity_rate", "direction")

#: Whole scene files; those that say the same as the intact one are marked.
SAME = {
    "byte order mark": lambda text: b"\xef\xbb\xbf" + text,
    "line ends of Windows": lambda text: text.replace(b"\n", b"\r\n"),
    "comments": lambda text: b"# \xce\xbcm\n" + text + b"\n# end",
    "blanks": lambda text: text.replace(b" = ", b"   =\t"),
}
BROKEN: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda text: b"",
    "UTF-16": lambda text: text.decode().encode("utf-16"),
    "Latin-1": lambda text: text + b"# \xb5m\n",
    "zero byte": lambda text: text[:40] + b"\0" + text[40:],
    "unknown key": lambda text: text + b"time.tolerence = 1e-4\n",
    "unknown table": lambda text: text + b"[tyme]\ntolerance = 1e-4\n",
    "key twice": lambda text: text + b"time.tolerance = 1e-5\n",
    "table twice": lambda text: text + b"[bodies.crank]\nmass = 1.0\n",
    "table as array": lambda text: text + b"[[time]]\ntolerance = 1e-4\n",
    "table as value": lambda text: b"time = 3\n" + text,
    "no value": lambda text: text + b"crank_length =\n",
    "no equals sign": lambda text: text + b"crank_length 0.048\n",
    "open string": lambda text: text + b'drive = "speed\n',
    "open bracket": lambda text: text + b"[film\ncells = [20\n",
    "no bodies": lambda text: re.sub(rb"(?m)^bodies.*$", b"", text),
    "no joints": lambda text: re.sub(rb"(?m)^joints.*$", b"", text),
    "scene of version 0.1": lambda text: b'scene = "slider-crank"\n[mechanism]\n',
    "body of another kind": lambda text: text.replace(b'"flexible"', b'"shaft"'),
    "no such kind": lambda text: text.replace(b'"flexible"', b'"flexibel"'),
    "kind a number": lambda text: text.replace(b'"flexible"', b"7"),
    "kind a list": lambda text: text.replace(b'"flexible"', b"[]"),
    "a joint that stays open": lambda text: text.replace(b"pin = [0.048, 0.0]", b"pin = [9, 0.0]"),
    "a loop twice": lambda text: (
        text + b'joints.x = {kind = "fixed", between = ["rod", "piston"]}\n'
    ),
    "a joint of nothing": lambda text: text.replace(b'"rod.bore"', b'"rod.boer"'),
    "a name with a slash": lambda text: text.replace(b"bodies.piston", b'bodies."../piston"'),
    "deep dotted key": lambda text: text + b".".join([b"a"] * 50_000) + b" = 1\n",
    "deep array": lambda text: text + b"cells = " + b"[" * 50_000 + b"]" * 50_000 + b"\n",
    "deep table": lambda text: text + b"[" + b".".join([b"a"] * 50_000) + b"]\n",
    "long key": lambda text: text + b"k" * 10**6 + b" = 1\n",
    "long integer": lambda text: text + b"time.cycles = " + b"7" * 5000 + b"\n",
    "binary": lambda text: bytes(range(256)) * 40,
    "JSON": lambda text: b'{"bodies": {}}',
    "carriage returns": lambda text: text.replace(b"\n", b"\r"),
}

#: What stands where a file should be.
PLACES = ("missing", "folder", "pipe", "loop", "device", "dangling link")


def put_in_place(place: str, path: Path) -> None:
    """Something that is no regular file."""
    path.unlink(missing_ok=True)
    if place == "folder":
        path.mkdir()
    elif place == "pipe":
        os.mkfifo(path)
    elif place == "loop":
        path.symlink_to(path.name)
    elif place == "device":
        path.symlink_to("/dev/null")
    elif place == "dangling link":
        path.symlink_to("nowhere")


def _edited(world: World, needed: tuple[str, ...], name: str, change: Callable) -> Callable:
    """Writes intact inputs, one of them changed."""

    def prepare(folder: Path) -> None:
        world.copy(needed, folder)
        path = folder / name
        path.write_bytes(change(path.read_bytes()))

    return prepare


def _elsewhere(world: World, needed: tuple[str, ...], name: str, place: str) -> Callable:
    def prepare(folder: Path) -> None:
        world.copy(needed, folder)
        put_in_place(place, folder / name)

    return prepare


def _cut_or_flipped(random: Random) -> Callable[[bytes], bytes]:
    where, bit, cut = random.random(), 1 << random.randrange(8), random.random() < 0.3

    def change(text: bytes) -> bytes:
        at = int(where * len(text))
        return text[:at] if cut else text[:at] + bytes([text[at] ^ bit]) + text[at + 1 :]

    return change


def scene_values(world: World, random: Random) -> Iterator[Case]:
    """Every key of every scene with values of the wrong type, and measures out of all range."""
    found = [
        (scene, key, value)
        for scene in SCENES
        for key, kind in _keys(tables_of(scene, {}))
        for value in WRONG_VALUES[kind]
    ]
    for scene, key, value in random.sample(found, len(found)):
        text = toml(tables_of(scene, {key: Raw(value)}))
        name = f"{scene} {key} = {value[:30]}"
        yield Case("scene values", name, _writer({"scene.toml": text}), command(
            "run", "scene.toml", "--no-plots", "-o", "out"), intact="run")  # fmt: skip


def _keys(tables: Mapping[str, Any], place: str = "") -> Iterator[tuple[str, type]]:
    """Dotted names of all keys and tables, and the type of what they hold."""
    for key, value in tables.items():
        yield f"{place}{key}", type(value)
        if isinstance(value, Mapping):
            yield from _keys(value, f"{place}{key}.")


def scene_extremes(world: World, random: Random) -> Iterator[Case]:
    """Numbers at the ends of what can be written: refused, or an answer of finite numbers."""
    found = [(key, value) for key in (*MEASURES, *OF_THE_MODEL) for value in EXTREME]
    for key, value in random.sample(found, len(found)):
        written = Raw(f"[{value}, 0.0]" if key.endswith(PAIRS) else value)
        part = {"bodies.rod.geometry": COARSE} if key in OF_THE_MODEL else ROD_OF_A_FILE
        changes = {**part, "time.revolutions": 0.002, key: written}

        def prepare(folder: Path, changes: dict = changes) -> None:
            world.copy(("rod.h5",), folder)
            (folder / "scene.toml").write_text(toml(tables_of("slider-crank-paper", changes)))

        yield Case("scene extremes", f"{key} = {value}", prepare, command(
            "run", "scene.toml", "--no-plots", "-o", "out"), slow=True)  # fmt: skip


def _writer(files: dict[str, str]) -> Callable[[Path], None]:
    def prepare(folder: Path) -> None:
        folder.mkdir(parents=True)
        for name, text in files.items():
            (folder / name).write_text(text)

    return prepare


def scene_texts(world: World, random: Random) -> Iterator[Case]:
    """Scene files that are no TOML, not the scene's, or no files."""
    needed, call = CALLS["run"]
    for name, change in {**SAME, **BROKEN}.items():
        prepare = _edited(world, needed, "scene.toml", change)
        yield Case("scene text", name, prepare, call, intact="run")
    for place in PLACES:
        prepare = _elsewhere(world, needed, "scene.toml", place)
        yield Case("scene text", place, prepare, call, intact="run")
    while True:
        prepare = _edited(world, needed, "scene.toml", _cut_or_flipped(random))
        yield Case("scene text", "cut or flipped", prepare, call, slow=True)


#: Tables, from the intact text.
TABLE_FAULTS: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda text: b"",
    "header alone": lambda text: text.splitlines(keepends=True)[0],
    "one row": lambda text: b"".join(text.splitlines(keepends=True)[:2]),
    "no header": lambda text: b"".join(text.splitlines(keepends=True)[1:]),
    "other header": lambda text: b"a,b,c\n" + text.split(b"\n", 1)[1],
    "nan": lambda text: text.replace(b"1", b"nan", 1),
    "infinite": lambda text: text.replace(b"20", b"inf", 1).replace(b"0.005", b"inf"),
    "text": lambda text: text.replace(b"\n0,", b"\nzero,", 1),
    "huge": lambda text: text[: text.rstrip().rfind(b",") + 1] + b"1e308\n",
    "beyond doubles": lambda text: text[: text.rstrip().rfind(b",") + 1] + b"1e400\n",
    "missing cell": lambda text: text.rstrip()[: text.rstrip().rfind(b",")] + b"\n",
    "empty cell": lambda text: text.rstrip()[: text.rstrip().rfind(b",") + 1] + b"\n",
    "cell too many": lambda text: text.rstrip() + b",5\n",
    "descending": lambda text: b"\n".join([text.split(b"\n")[0], *text.split(b"\n")[-2:0:-1], b""]),
    "row twice": lambda text: text + text.splitlines(keepends=True)[-1],
    "does not close": lambda text: text[: text.rstrip().rfind(b",") + 1] + b"77\n",
    "decimal commas": lambda text: text.replace(b",", b";").replace(b".", b","),
    "semicolons": lambda text: text.replace(b",", b";"),
    "open quote": lambda text: text.replace(b"\n0,", b'\n"0,', 1),
    "long field": lambda text: text.replace(b"\n0,", b"\n" + b"0" * 200_000 + b"x,", 1),
    "zero byte": lambda text: text.replace(b"\n0,", b"\n\x000,", 1),
    "UTF-16": lambda text: text.decode().encode("utf-16"),
    "Latin-1": lambda text: b"# \xb5\n" + text,
    "binary": lambda text: bytes(range(256)) * 40,
    "carriage returns": lambda text: text.replace(b"\n", b"\r"),
    "underscores": lambda text: text.replace(b"10", b"1_0"),
    "other digits": lambda text: text.replace(b"1", "１".encode()),
    "complex": lambda text: text.replace(b"\n0,", b"\n0j,", 1),
}


def tables(world: World, random: Random) -> Iterator[Case]:
    """Tables of forces and torques."""
    found = [(t, name) for t in TABLES for name in (*SAME, *TABLE_FAULTS, *PLACES)]
    for table, name in random.sample(found, len(found)):
        intact = "journal" if table == "load.csv" else "run"
        needed, call = CALLS[intact]
        if name in PLACES:
            prepare = _elsewhere(world, needed, table, name)
        else:
            if name in ("comments", "blanks"):  # a table has none
                continue
            prepare = _edited(world, needed, table, {**SAME, **TABLE_FAULTS}[name])
        yield Case("tables", f"{table} {name}", prepare, call, intact=intact)
    while True:
        table = random.choice(list(TABLES))
        needed, call = CALLS["journal" if table == "load.csv" else "run"]
        prepare = _edited(world, needed, table, _cut_or_flipped(random))
        yield Case("tables", f"{table} cut or flipped", prepare, call, slow=True)


NUMBERS = ("nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "", "x", "0x10", "1_0", "１")
BEARING = ("eccentricity", "load", "radius", "clearance", "width", "viscosity", "speed",
           "bore-speed", "ambient", "barus", "roelands")  # fmt: skip

#: Calls that have to be refused, besides those of test_refused_at_once.py.
REFUSED = (
    ("run", "."), ("run", "slider-crank", "rotor"), ("run", "slider-crank", "--body", "."),
    ("run", "slider-crank", "-o", "file/out"), ("run", "slider-crank", "-o", "/dev/null/out"),
    ("run", "slider-crank", "--method", "m5"), ("run", "slider-crank", "--frames", "1", "--vtk"),
    ("run", "slider-crank", "--checkpoint-every", "-1"), ("run", "--resume", "."),
    ("run", "slider-crank", "--checkpoint-every", "nan", "-o", "/dev/null/out"),
    ("run", "--resume", ""), ("run", "--resume", "out", "x.toml"),
    ("reduce",), ("reduce", "conrod"), ("reduce", "piston", "-o", "x.h5"),
    ("reduce", "conrod", "-o", "file/x.h5"), ("reduce", "conrod", "-o", "."),
    ("reduce", "conrod", "-o", "x.h5", "--modes", "-1"),
    ("reduce", "conrod", "-o", "x.h5", "--method", "m1", "--modes", "0"),
    ("reduce", "conrod", "-o", "x.h5", "--residual-modes", "1000000"),
    ("reduce", "conrod", "-o", "x.h5", "--vibration-modes", "-3"),
    ("reduce", "conrod", "-o", "x.h5", "--selection", "best"),
    ("reduce", "conrod", "-o", "x.h5", "--pressure-set", "pc3"),
    ("reduce", "conrod", "-o", "x.h5", "--snapshots", "nowhere"),
    ("reduce", "conrod", "-o", "x.h5", "--residual-truncation", "nan"),
    ("reduce", "conrod", "-o", "x.h5", "--scene", "nothing.toml"),
    ("init", "piston"), ("plot",), ("plot", "file"), ("animate", "nowhere"),
    ("animate", "."), ("animate", "file"), ("report", "nowhere"), ("report", "."), ("sweep",),
    ("study", "bearing"), ("study",), ("check", "x"), ("--nonsense",),
    ("sweep", "slider-crank", "--set", "a=1", "-o", "s"),
    ("sweep", "slider-crank", "--set", "oil.viscosity=nan", "-o", "s"),
    ("bearing", "--load", "1e300"), ("bearing", "--load", "5", "--cells", "64x0"),
    ("bearing", "--load", "5", "--cells", "9999999999x1"),
    ("bearing", "--load", "5", "--cells", "64x12x1"), ("bearing", "--load", "1_0"),
    ("bearing", "--load", "5", "--cells", "\u0661\u0666x4"),
    ("bearing", "--load", "5", "--lobes", "3"),
    ("bearing", "--load", "5", "--conducted", "0.5"), ("bearing", "--load", "5", "--lobes", "1_0"),
    ("run", "loaded-journal", "--frames", "5"), ("run", "--resume", "file", "--vtk"),
    ("reduce", "conrod", "-o", "x.h5", "--method", "m4", "--residual-modes", "5"),
    ("animate", "file", "--scale", "nan"), ("animate", "file", "--frames", "1_0"),
    ("part", "file", "--held", "3"), ("stress", "file", "--no-damping", "--complete"),
    ("sweep", "slider-crank", "--set", "order=1_0,2", "-o", "s"),
    ("sweep", "slider-crank", "--set", "tolerance=1e-5:1e-4:\u0663", "-o", "s"),
    ("bearing", "--load", "2000", "--bore-speed", "-500"),
    ("bearing", "--eccentricity", "0.5", "--speed", "-300", "--bore-speed", "300.001"),
)  # fmt: skip


def options(world: World, random: Random) -> Iterator[Case]:
    """Command lines."""

    def prepare(folder: Path) -> None:
        folder.mkdir(parents=True)
        (folder / "file").write_text("a file")

    for arguments in random.sample(REFUSED, len(REFUSED)):
        name = " ".join(repr(a) if not a else a for a in arguments)
        slow = arguments[0] == "bearing"  # a load that no film carries is looked for
        yield Case("options", name, prepare, command(*arguments), intact="run", slow=slow)
    found = [(option, number) for option in BEARING for number in NUMBERS]
    for option, number in random.sample(found, len(found)):
        given = ("bearing", "--json", "--cells", "20x4", f"--{option}={number}")
        if option not in ("eccentricity", "load"):
            given += ("--eccentricity", "0.6")
        name = f"bearing --{option}={number}"
        yield Case("options", name, prepare, command(*given), slow=True)
