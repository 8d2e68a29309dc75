"""Malformed HDF5 files and matrices."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from random import Random

import h5py
import numpy as np
from cases import Case
from texts import PLACES, put_in_place
from world import CALLS, World

from fenics_ehd.base.sealed_file import seal


def _flipped(content: bytes, random: Random) -> bytes:
    at = random.randrange(len(content))
    return content[:at] + bytes([content[at] ^ (1 << random.randrange(8))]) + content[at + 1 :]


def _zeroed(content: bytes, random: Random) -> bytes:
    at = random.randrange(len(content))
    size = min(random.choice([8, 512, 4096]), len(content) - at)
    return content[:at] + bytes(size) + content[at + size :]


#: What an accident of a disk or a copy does to a file.
ACCIDENTS: dict[str, Callable[[bytes, Random], bytes]] = {
    "flipped bit": _flipped,
    "block of zeros": _zeroed,
    "cut": lambda content, random: content[: random.randrange(len(content))],
    "empty": lambda content, random: b"",
    "all zeros": lambda content, random: bytes(len(content)),
    "text": lambda content, random: b"a text file\n",
    "two in one": lambda content, random: content + content,
    "swapped halves": lambda content, random: (
        content[len(content) // 2 :] + content[: len(content) // 2]
    ),
}


def _names(file: h5py.File, kind: type) -> list[str]:
    found: list[str] = []
    file.visititems(lambda name, thing: found.append(name) if isinstance(thing, kind) else None)
    return sorted(found)


def _replaced(file: h5py.File, name: str, array: object, **more: object) -> None:
    kept = dict(file[name].attrs)
    del file[name]
    file.create_dataset(name, data=array, **more)
    file[name].attrs.update(kept)


def _one_entry(value: float) -> Callable:
    def change(file: h5py.File, name: str, random: Random) -> None:
        array = file[name][()]
        flat = np.atleast_1d(array).astype(float).reshape(-1)
        flat[random.randrange(flat.size)] = value
        _replaced(file, name, flat.reshape(np.shape(array)))

    return change


def _as(change: Callable[[np.ndarray], np.ndarray]) -> Callable:
    return lambda file, name, random: _replaced(file, name, change(np.asarray(file[name][()])))


def _unallocated(file: h5py.File, name: str, random: Random) -> None:
    """A dataset of petabytes of which nothing is stored."""
    kind, rank = file[name].dtype, max(file[name].ndim, 1)
    kept = dict(file[name].attrs)
    del file[name]
    file.create_dataset(name, (10**14, *[3] * (rank - 1)), kind, chunks=(1000, *[3] * (rank - 1)))
    file[name].attrs.update(kept)


def _link_to_itself(file: h5py.File, name: str, random: Random) -> None:
    del file[name]
    file[name] = h5py.SoftLink(f"/{name}")


def _elsewhere(file: h5py.File, name: str, random: Random) -> None:
    del file[name]
    file[name] = h5py.ExternalLink("nowhere.h5", name)


def _group(file: h5py.File, name: str, random: Random) -> None:
    del file[name]
    file.create_group(name)


def _missing(file: h5py.File, name: str, random: Random) -> None:
    del file[name]


#: What a program that writes such files itself may get wrong, in one dataset.
DATASETS: dict[str, Callable] = {
    "not a number": _one_entry(np.nan),
    "infinite": _one_entry(np.inf),
    "huge": _one_entry(1e308),
    "negative": _one_entry(-1e6),
    "times a thousand": _as(lambda a: 1000 * a if a.dtype.kind in "fiu" else a[:0]),
    "zeros": _as(lambda a: np.zeros_like(a)),
    "reversed": _as(
        lambda a: np.flip(a) + (1 if a.dtype.kind in "iu" else 0) if a.ndim else a[None]
    ),
    "row too few": _as(lambda a: a[:-1] if a.ndim else np.array([a, a])),
    "column too few": _as(lambda a: a[..., :-1] if a.ndim else np.array([a])),
    "one more axis": _as(lambda a: a[None]),
    "flat": _as(lambda a: np.append(a.reshape(-1), a.reshape(-1)[:1])),
    "nothing": _as(lambda a: a.reshape(-1)[:0]),
    "single precision": _as(
        lambda a: a.astype("f4") + np.float32(1e-3) if a.dtype.kind == "f" else a[:0]
    ),
    "text": _as(lambda a: np.full(a.shape, b"text") if a.dtype.kind != "S" else np.zeros(3)),
    "complex": _as(lambda a: a + 1j if a.dtype.kind in "fiu" else a[:0]),
    "truth values": _as(lambda a: a.astype(bool) if a.dtype.kind in "fiu" else a[:0]),
    "petabytes": _unallocated,
    "group": _group,
    "missing": _missing,
    "link to itself": _link_to_itself,
    "link to nowhere": _elsewhere,
}

#: The same in one attribute.
ATTRIBUTES: dict[str, Callable] = {
    "missing": lambda attributes, name: attributes.__delitem__(name),
    "text": lambda attributes, name: attributes.__setitem__(name, "text, not what it was"),
    "array": lambda attributes, name: attributes.__setitem__(name, np.arange(3.0)),
    "not a number": lambda attributes, name: attributes.__setitem__(name, np.nan),
    "huge": lambda attributes, name: attributes.__setitem__(name, 1e308),
    "nothing": lambda attributes, name: attributes.__setitem__(name, h5py.Empty("f")),
}


def _doubled(file: h5py.File, name: str, random: Random) -> None:
    """Groups that a path leads through in 2^22 ways, in place of a dataset."""
    del file[name]
    group = file.create_group(name)
    for _ in range(22):
        inner = group.create_group("a")
        group["b"] = inner
        group = inner


def _packed_away(file: h5py.File, name: str, random: Random) -> None:
    """300 shapes of which no byte is stored, next to a dataset."""
    place = name.rpartition("/")[0]
    for number in range(300):
        file.create_dataset(f"{place}/x{number}", (2**21,), chunks=(2**16,), compression="gzip")


def _to_the_root(file: h5py.File, name: str, random: Random) -> None:
    del file[name]
    file[name] = h5py.SoftLink("/")


#: What no other number explains, in a file that is sealed again.
MISFITS: dict[str, Callable] = {
    "doubled links": _doubled,
    "packed away": _packed_away,
    "link to all": _to_the_root,
} | {
    name: DATASETS[name]
    for name in (
        "not a number", "infinite", "row too few", "column too few", "one more axis", "flat",
        "nothing", "text", "complex", "truth values", "petabytes", "group", "missing",
        "link to itself", "link to nowhere",
    )
}  # fmt: skip


def sealed_again(world: World, random: Random) -> Iterator[Case]:
    """Files of every class with a misfit, and the seal of what they are then."""
    files = (
        ("run", "rod.h5"), ("structure", "part.h5"), ("resume", "history.h5"),
        ("resume", "body-rod.h5"),
    )  # fmt: skip

    def prepare(needed: tuple[str, ...], file_name: str, what: Callable, seed: int) -> Callable:
        def write(folder: Path) -> None:
            world.copy(needed, folder)
            path = next(iter(sorted(folder.rglob(file_name))))
            own = Random(seed)
            with h5py.File(path, "r+") as file:
                names = _names(file, h5py.Dataset)
                for name in own.sample(names, len(names)):
                    # Not every dataset can be changed in every way.
                    with suppress(AttributeError, IndexError, TypeError, ValueError):
                        what(file, name, own)
                        break
            seal(path, path)

        return write

    while True:
        for name, what in random.sample([*MISFITS.items()], len(MISFITS)):
            intact, file_name = random.choice(files)
            needed, call = CALLS[intact]
            seed = random.randrange(2**32)
            yield Case(
                "sealed again", f"{file_name} {name} ({seed})",
                prepare(needed, file_name, what, seed), call,
            )  # fmt: skip


def _hdf5_case(
    world: World, group: str, intact: str, file_name: str, random: Random
) -> Iterator[Case]:
    """Accidents and mistakes, in turn, of one file of an intact call."""
    needed, call = CALLS[intact]
    seeds = iter(lambda: random.randrange(2**32), None)

    def prepare(change: Callable[[Path, Random], None], seed: int) -> Callable[[Path], None]:
        def write(folder: Path) -> None:
            world.copy(needed, folder)
            path = next(iter(sorted(folder.rglob(file_name))))
            change(path, Random(seed))

        return write

    def accident(what: Callable[[bytes, Random], bytes]) -> Callable[[Path, Random], None]:
        return lambda path, own: path.write_bytes(what(path.read_bytes(), own)) and None

    def dataset(what: Callable) -> Callable[[Path, Random], None]:
        def change(file: h5py.File, own: Random) -> None:
            names = _names(file, h5py.Dataset)
            for name in own.sample(names, len(names)):
                # Not every dataset can be changed in every way.
                with suppress(AttributeError, IndexError, TypeError, ValueError):
                    what(file, name, own)
                    return

        return inside(change)

    def attribute(what: Callable) -> Callable[[Path, Random], None]:
        def change(file: h5py.File, own: Random) -> None:
            holders = [h for h in (file, *map(file.get, _names(file, h5py.Group))) if h.attrs]
            if holders:
                holder = own.choice(holders)
                what(holder.attrs, own.choice(sorted(holder.attrs)))

        return inside(change)

    def inside(what: Callable[[h5py.File, Random], None]) -> Callable[[Path, Random], None]:
        def change(path: Path, own: Random) -> None:
            try:
                with h5py.File(path, "r+") as file:
                    what(file, own)
            except OSError:  # the history of a killed run is open for ever
                accident(_flipped)(path, own)

        return change

    def place(what: str) -> Callable[[Path, Random], None]:
        return lambda path, own: put_in_place(what, path)

    changes = [(name, accident(what)) for name, what in ACCIDENTS.items()]
    changes += [("flipped bit", accident(_flipped))] * 8
    changes += [(f"dataset {name}", dataset(what)) for name, what in DATASETS.items()]
    changes += [(f"attribute {name}", attribute(what)) for name, what in ATTRIBUTES.items()]
    changes += [(name, place(name)) for name in PLACES]
    while True:
        for name, change in random.sample(changes, len(changes)):
            seed = next(seeds)
            yield Case(
                group, f"{file_name} {name} ({seed})", prepare(change, seed), call, intact=intact
            )


def bodies(world: World, random: Random) -> Iterator[Case]:
    """The body of a run."""
    return _hdf5_case(world, "body", "run", "rod.h5", random)


def structures(world: World, random: Random) -> Iterator[Case]:
    """A whole part."""
    return _hdf5_case(world, "structure", "structure", "part.h5", random)


def stopped_runs(world: World, random: Random) -> Iterator[Case]:
    """History and body of a run that shall go on."""
    files = ("history.h5", "history.h5", "history.h5", "body-rod.h5")
    streams = [_hdf5_case(world, "stopped run", "resume", name, random) for name in files]
    while True:
        for stream in streams:
            yield next(stream)


def _number(position: int, value: int) -> Callable[[bytes], bytes]:
    """Big-endian integer in PETSc's binary format."""
    at = 4 * position
    return lambda content: content[:at] + value.to_bytes(4, "big", signed=True) + content[at + 4 :]


#: Header (kind, rows, columns, entries), row lengths, column indices, values; 36 rows.
PETSC = {
    "other kind": _number(0, 7),
    "more rows": _number(1, 39),
    "rows not of three": _number(1, 35),
    "negative rows": _number(1, -36),
    "no rows": _number(1, 0),
    "fewer columns": _number(2, 3),
    "huge columns": _number(2, 2**31 - 1),
    "more entries": _number(3, 2**30),
    "fewer entries": _number(3, 10),
    "negative entries": _number(3, -1),
    "long row": _number(4, 2**30),
    "negative row": _number(4, -5),
    "column of two thousand millions": _number(4 + 36, 2_000_000_000),
    "column beyond the matrix": _number(4 + 36, 99),
    "negative column": _number(4 + 36, -1),
    "column twice": lambda content: content[:160] + content[164:168] + content[164:],
    "other byte order": lambda content: np.frombuffer(content[:-4], ">i4").astype("<i4").tobytes(),
}

MARKET = {
    "no header": lambda text: text.split(b"\n", 1)[1],
    "complex": lambda text: text.replace(b" real ", b" complex ", 1),
    "pattern": lambda text: text.replace(b" real ", b" pattern ", 1),
    "dense": lambda text: text.replace(b"coordinate", b"array", 1),
    "index beyond": lambda text: text.replace(b"\n1 1 ", b"\n99 1 ", 1),
    "index zero": lambda text: text.replace(b"\n1 1 ", b"\n0 1 ", 1),
    "index huge": lambda text: text.replace(b"\n1 1 ", b"\n99999999999999999999 1 ", 1),
    "text": lambda text: text.replace(b"\n1 1 ", b"\n1 1 x", 1),
    "line missing": lambda text: text.rstrip().rsplit(b"\n", 1)[0] + b"\n",
    "line too many": lambda text: text + b"3 3 1.0\n",
    "sizes": lambda text: text.replace(b"36 36 ", b"36 35 ", 1),
    "sizes not of three": lambda text: text.replace(b"36 36 ", b"37 37 ", 1),
    "sizes huge": lambda text: text.replace(b"36 36 ", b"999999999999 999999999999 ", 1),
}


def _archive(**changes: object) -> Callable[[Path], None]:
    """SciPy's archive with other arrays; None leaves one out."""

    def change(path: Path) -> None:
        with np.load(path) as stored:
            arrays = dict(stored)
        arrays |= {k: v(arrays[k]) if callable(v) else v for k, v in changes.items()}
        np.savez(path, **{k: v for k, v in arrays.items() if v is not None})

    return change


NPZ = {
    "no data": _archive(data=None),
    "no shape": _archive(shape=None),
    "no format": _archive(format=None),
    "other format": _archive(format=np.array("nothing")),
    "objects": _archive(data=lambda a: np.array([print] * len(a), dtype=object)),
    "text": _archive(data=lambda a: a.astype(str)),
    "complex": _archive(data=lambda a: a + 1j),
    "fewer data": _archive(data=lambda a: a[:-3]),
    "two axes": _archive(data=lambda a: a[None]),
    "index beyond": _archive(indices=lambda a: a + 30),
    "negative index": _archive(indices=lambda a: a - 5),
    "pointers descend": _archive(indptr=lambda a: a[::-1].copy()),
    "pointers beyond": _archive(indptr=lambda a: a * 1000),
    "shape of three": _archive(shape=np.array([36, 36, 1])),
    "shape not of three": _archive(shape=np.array([35, 36])),
    "shape negative": _archive(shape=np.array([-36, 36])),
    "shape huge": _archive(shape=np.array([2**60, 2**60])),
}


#: What means something, if not the intact matrix: entries that add up, and ones.
MEANING = ("column twice", "pattern")


def matrices(world: World, random: Random) -> Iterator[Case]:
    """Matrices of other programs; a changed number is no fault that can be found."""

    def prepare(name: str, change: Callable[[Path], None]) -> Callable[[Path], None]:
        def write(folder: Path) -> None:
            world.copy((name,), folder)
            change(folder / name)

        return write

    def bytewise(what: Callable[[bytes], bytes]) -> Callable[[Path], None]:
        return lambda path: path.write_bytes(what(path.read_bytes())) and None

    targeted = [("k.dat", n, bytewise(what)) for n, what in PETSC.items()]
    targeted += [("k.mtx", n, bytewise(what)) for n, what in MARKET.items()]
    targeted += [("k.npz", n, change) for n, change in NPZ.items()]
    targeted += [
        (name, place, lambda path, place=place: put_in_place(place, path))
        for name in ("k.dat", "k.mtx", "k.npz")
        for place in PLACES
    ]
    for name, what, change in random.sample(targeted, len(targeted)):
        intact = None if what in MEANING else name
        yield Case("matrices", f"{name} {what}", prepare(name, change), CALLS[name][1], intact)
    while True:
        name, what = random.choice(["k.dat", "k.mtx", "k.npz"]), random.choice(list(ACCIDENTS))
        seed = random.randrange(2**32)
        change = bytewise(lambda b, what=what, seed=seed: ACCIDENTS[what](b, Random(seed)))
        yield Case("matrices", f"{name} {what} ({seed})", prepare(name, change), CALLS[name][1])
