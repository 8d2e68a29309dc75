"""Stored files that were changed and sealed again: any value is refused by its name.

Every value of every stored class gets another shape, another type, a row less, is left out, or
holds NaN; nothing but a named error may come of it.
"""

import os
import shutil
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from foreign_parts import ring
from hand_made_rod import Joint, flexible, with_residual
from mpi4py import MPI
from scene_cases import LOADED_JOURNAL, ROD_OF_A_FILE, write_scene
from scipy import sparse

import fenics_ehd as ehd
from fenics_ehd.base.sealed_file import seal
from fenics_ehd.multibody.periodic import PeriodicSolver
from fenics_ehd.multibody.recorder import Recorder
from fenics_ehd.multibody.run import Run
from fenics_ehd.reduction.part_files import BasisFile, load_structure, save_basis, save_structure
from fenics_ehd.reduction.structure import Recovery, check_structure
from fenics_ehd.results.recorded_run import continue_from, load_run_state, save_run_state
from fenics_ehd.scenes.scene import as_stored

FILE = "history.h5"

#: A body of M4 that commit e607198 stored.
GOLDEN = Path(__file__).parent / "golden" / "house" / "rod-m4.h5"


def replaced(change):
    """A change of a dataset's array; its attributes stay."""

    def act(file, name):
        item = file[name]
        array, attributes = change(item[()]), dict(item.attrs)
        del file[name]
        file[name] = array
        file[name].attrs.update(attributes)

    return act


def unlike(array):
    """The same entries as another kind of number, or as numbers if they are text."""
    array = np.asarray(array)
    return np.zeros(array.shape) if array.dtype.kind in "OS" else array.astype(complex)


def as_text(array):
    """Text in place of numbers, numbers in place of text."""
    array = np.asarray(array)
    return np.zeros(array.shape) if array.dtype.kind in "OS" else np.full(array.shape, b"text")


def with_nan(array):
    """One entry that is no number; None: the array has no such entry."""
    array = np.array(array)
    if array.dtype.kind != "f" or not array.size:
        return None
    array.reshape(-1)[array.size // 2] = np.nan
    return array


def shorter(array):
    """A row less; None: it has no row."""
    array = np.asarray(array)
    return array[:-1] if array.ndim and len(array) else None


CHANGES = {
    "one more axis": lambda array: np.asarray(array)[None],
    "a row less": shorter,
    "a column less": lambda a: a[..., :-1] if np.ndim(a) > 1 and a.shape[-1] else None,
    "another type": lambda array: unlike(array) if np.size(array) else None,
    "text": lambda array: as_text(array) if np.size(array) else None,
    "not a number": with_nan,
}


def write_body(path):
    joint = Joint()
    ehd.save_body(with_residual(joint, flexible(joint)[0]), path)


def write_part(path):
    save_structure(ring(comm=MPI.COMM_SELF), path)


def write_basis(path):
    """Of a part that has cells and knows its stresses in one of them."""
    part = ring(comm=MPI.COMM_SELF)
    random = np.random.default_rng(1)
    stress = SimpleNamespace(
        shape=(1, 8, 6, 3),
        positions=lambda cells: random.standard_normal((1, 8, 3)),
        block=lambda cells, modes: random.standard_normal((1, 8, 6, 3)),
    )
    nodes = len(part.coordinates)
    cells = np.resize(np.arange(nodes), (-(-nodes // 20), 20))
    recovery = Recovery(cells, lambda columns: stress)
    save_basis(path, replace(part, recovery=recovery), random.standard_normal((part.size, 3)))


def read_part(path):
    check_structure(load_structure(path, MPI.COMM_SELF))


def read_basis(path):
    with BasisFile(path) as file:
        q = np.ones(file.modes)
        for name in ("nodes", "cells"):
            getattr(file, name)
        file.displacement(q)
        file.stress(q)
        assert len(file.stress_points)


def simulation(place):
    """A simulation at its start of the scene at a place, and its mechanism's files there."""
    scene = as_stored(place / "scene.toml")
    built = ehd.build(scene)
    run = Run(built.mechanism, built.steps, scene.span)
    cycles = PeriodicSolver(run, scene.span, 1e-3, 4) if scene.time.periodic else None
    return Recorder(run, scene.span, cycles)


def write_run(scene, changes):
    """A writer of a run's first steps with its checkpoint."""

    def write(path):
        joint = Joint()
        ehd.save_body(with_residual(joint, flexible(joint)[0]), path.parent / "rod.h5")
        write_scene(path.parent / "scene.toml", scene, changes)
        run = simulation(path.parent)
        for _, _step in zip(range(4), run.steps(), strict=False):
            pass
        about = {"about": {"reduction_time_s": 0.0, "scene": scene}, "digests": {"a": "b"}}
        save_run_state(run, path.parent, about)

    return write


def read_history(path):
    ehd.load_history(path.parent)


#: Simulations at their start, by folder: one that nothing was brought to is still there.
FRESH = {}


def go_on(path):
    folder = path.parent
    former = load_run_state(folder)
    if folder not in FRESH:
        FRESH[folder] = simulation(folder)
    run = FRESH[folder]
    continue_from(former, run, folder)
    del FRESH[folder]
    next(run.steps())


JOURNAL = LOADED_JOURNAL | {"time.periodic": True}
ROD = ROD_OF_A_FILE | {"time.revolutions": 0.005}

#: Of every class how a file is written and read, and what of it changes.
STORED = {
    "body": (write_body, ehd.load_body, ""),
    "body of version 0.3": (
        lambda path: shutil.copyfile(GOLDEN, path),
        ehd.load_body,
        "bores residual",
    ),
    "part": (write_part, read_part, ""),
    "basis": (write_basis, read_basis, ""),
    "history": (write_run("slider-crank-paper", ROD), read_history, "bodies joints run time state"),
    "checkpoint of a machine": (write_run("slider-crank-paper", ROD), go_on, "resume state"),
    "checkpoint of a search": (write_run("loaded-journal", JOURNAL), go_on, "resume"),
}

#: Values that may be left out, and those that may be undefined.
OPTIONAL = (
    "cells", "family", "reference", "centre", "fluid_fraction", "quasi_static", "residual",
    "attachments", "bores", "points", "rigid_", "mesh_flexibility", "provenance", "accuracy",
    "digests", "rejected_because", "estimates", "solver", "multipliers", "corner", "powers",
    "joints/big_end/film",
)  # fmt: skip

#: Sizes that only the mechanism has, which `go_on` knows.
OF_THE_MECHANISM = ("state/multipliers", "state/quasi_static", "state/powers")
UNDEFINED = ("frequenc", "participation", "accuracy", "defect", "moved", "left", "contraction",
             "power", "flow", "run/", "bodies/", "joints/")  # fmt: skip


#: Groups whose members have one declaration, of which two are changed.
ALIKE = ("provenance", "accuracy", "run", "bodies/crank", "bodies/rod", "bodies/piston",
         "joints/big_end", "joints/bearing", "digests")  # fmt: skip


def names_in(path, wanted):
    """Groups and datasets to change, and whether each is a dataset."""
    names, found, counts = [], [], Counter()
    with h5py.File(path) as file:
        file.visit(names.append)
        for name in names:
            group = name.rpartition("/")[0]
            counts[group] += 1
            if group in ALIKE and counts[group] > 2 and not name.endswith("/film"):
                continue
            if not wanted or name.split("/")[0] in wanted.split():
                found.append((name, isinstance(file[name], h5py.Dataset)))
    return found


def outcome(kind, path):
    """None if the file is read, the message of a named error, or what else came of it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            STORED[kind][1](path)
    except ehd.errors.EhdError as error:
        return str(error)
    return None


def harmless(kind, name, how):
    """True of values that cannot be known to be wrong, or that are allowed."""
    if how == "missing":
        return any(word in name for word in OPTIONAL)
    if how == "not a number":
        return any(word in name for word in UNDEFINED)
    if how == "a row less":  # a part may have fewer cells
        return (kind, name) == ("basis", "cells")
    return kind == "history" and how == "a column less" and name in OF_THE_MECHANISM


#: Too many to try with every change of the program.
SLOW = "checkpoint of a machine"


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=pytest.mark.slow) if k == SLOW else k for k in STORED]
)
def test_a_changed_value_is_refused_by_a_named_error(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)  # hundreds of files
    path, whole = tmp_path / FILE, tmp_path / "whole.h5"
    STORED[kind][0](path)
    assert outcome(kind, path) is None
    shutil.copyfile(path, whole)
    believed = []
    for name, data in names_in(whole, STORED[kind][2]):
        for how, change in [*CHANGES.items(), ("missing", None)]:
            shutil.copyfile(whole, path)
            with h5py.File(path, "r+") as file:
                if change is None:
                    del file[name]
                elif data and change(file[name][()]) is not None:
                    replaced(change)(file, name)
                else:
                    continue
            seal(path, path)
            try:
                message = outcome(kind, path)
            except Exception as error:
                pytest.fail(f"{kind}, {name}, {how}: {type(error).__name__}: {error}")
            assert "\n" not in (message or "")
            if message is None:
                believed.append((name, how))
    assert not [pair for pair in believed if not harmless(kind, *pair)]


def indefinite(matrix):
    """The same diagonal, and a pair of entries beyond it."""
    matrix[0, 1] = matrix[1, 0] = 1.01 * np.sqrt(matrix[0, 0] * matrix[1, 1])
    return matrix


def askew(matrix):
    matrix[0, 1] += 1e-6 * matrix[0, 0]
    return matrix


def moved(coordinates):
    coordinates[7, :2] *= 1.0 + 1e-5
    return coordinates


#: Numbers of the right kind and shape that are none of a part: dataset, change, message.
IMPOSSIBLE = [
    ("stiffness", indefinite, "/stiffness is not positive semidefinite"),
    ("stiffness", lambda matrix: -matrix, "/stiffness is not positive semidefinite"),
    ("stiffness", askew, "/stiffness is not symmetric"),
    ("mass", indefinite, "/mass is not positive semidefinite"),
    ("inertia/mass", indefinite, "/inertia/mass is not positive semidefinite"),
    ("residual/stiffness", lambda values: -values, "/residual/stiffness holds"),
    ("bores/bore/coordinates", moved, "m off the cylinder of radius 0.0225 m"),
    ("bores/bore/pressure_coordinates", moved, "m off the cylinder of radius 0.0225 m"),
    ("bores/bore/radius", lambda radius: np.float64(1.001 * radius), "off the cylinder"),
    ("bores/bore/cells", lambda cells: cells + 1, "must use each of the 110 nodes"),
    (
        "bores/bore/cells",
        lambda cells: np.delete(cells, 15, axis=0),
        "a rim of 4 edges is too short for a hole",
    ),
    ("points/pin", lambda fields: fields[:2], "/points/pin has shape (2, 12), not (3, 12)"),
]


@pytest.mark.parametrize(("name", "change", "message"), IMPOSSIBLE)
def test_a_body_that_no_part_has_is_refused(name, change, message, tmp_path):
    path = tmp_path / "rod.h5"
    shutil.copyfile(GOLDEN, path)
    with h5py.File(path, "r+") as file:
        replaced(change)(file, name)
    seal(path, path)
    with pytest.raises(ehd.errors.BodyFileError) as caught:
        ehd.load_body(path)
    assert message in str(caught.value)


def test_a_part_with_an_indefinite_stiffness_is_refused(tmp_path):
    """A pair of entries far from the diagonal, both triangles alike."""
    part = ring(comm=MPI.COMM_SELF)
    pointers, columns, entries = part.stiffness.getValuesCSR()
    matrix = sparse.csr_matrix((entries, columns, pointers))
    diagonal = matrix.diagonal()
    beyond = 1.1 * np.sqrt(diagonal[3] * diagonal[100]) - matrix[3, 100]
    pair = sparse.coo_matrix(([beyond, beyond], ([3, 100], [100, 3])), matrix.shape)
    with pytest.raises(ehd.errors.StructureError) as caught:
        check_structure(replace(part, stiffness=(matrix + pair).tocsr()))
    assert "stiffness is not positive semidefinite: the entry" in str(caught.value)
    assert "of node 1, component x and node 33, component y is 1.1 times" in str(caught.value)
