"""Names in files: those of commit e607198 are read, and files of today have the same ones."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.base.layout import Group, Stateful, Value
from fenics_ehd.reduction.body import export_npz
from fenics_ehd.reduction.part_files import (
    BasisFile,
    load_structure,
    save_basis,
    save_structure,
)

STORED = Path(__file__).parent / "golden" / "stored"

#: Numbers of coordinates by method.
MODES = {"m1": 8, "m4": 9}


def contents(path):
    """Arrays of an HDF5 file by path, and its attributes by path and name."""
    arrays = {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset):
            arrays[name] = item[()]
        arrays.update({f"{name}@{key}": value for key, value in item.attrs.items()})

    with h5py.File(path) as file:
        visit("", file)
        file.visititems(visit)
    return arrays


def assert_same(now, former):
    """Same names in the same order, same types, same bits."""
    assert list(now) == list(former)
    for name, value in former.items():
        assert np.asarray(now[name]).dtype == np.asarray(value).dtype, name
        np.testing.assert_array_equal(now[name], value, err_msg=name)


@pytest.mark.parametrize("method", MODES)
def test_a_stored_body_is_read_and_written_with_the_same_names(method, tmp_path):
    body = ehd.load_body(STORED / f"body-{method}.h5")
    assert body.modes == MODES[method]
    assert list(body.points) == ["left", "right"]
    assert (body.residual is not None) == (method == "m4")
    ehd.save_body(body, tmp_path / "body.h5")
    assert_same(contents(tmp_path / "body.h5"), contents(STORED / f"body-{method}.h5"))


@pytest.mark.parametrize("method", MODES)
def test_an_export_has_the_names_of_a_stored_one(method, tmp_path):
    body = ehd.load_body(STORED / f"body-{method}.h5")
    with np.load(STORED / f"body-{method}.npz", allow_pickle=False) as file:
        former = dict(file)
    with np.load(export_npz(body, tmp_path / "body.npz"), allow_pickle=False) as file:
        now = dict(file)
    order = np.argsort(former["points"])  # a body of a file has its points in order of their names
    for name in ("points", "point_position", "point_basis"):
        former[name] = former[name][order]
    assert_same(dict(sorted(now.items())), dict(sorted(former.items())))


def test_a_stored_part_is_read_and_written_with_the_same_names(tmp_path):
    part = load_structure(STORED / "part.h5", MPI.COMM_SELF)
    assert list(part.attachments) == ["right", "left"]
    assert part.bores["bore"].radius == pytest.approx(0.02)
    save_structure(part, tmp_path / "part.h5")
    assert_same(contents(tmp_path / "part.h5"), contents(STORED / "part.h5"))
    # The same part, and the same program: the same modes to the last digits.
    body = ehd.load_body(STORED / "body-m1.h5")
    assert ehd.craig_bampton(part, 4).frequencies == pytest.approx(body.frequencies, rel=1e-8)


def test_a_stored_basis_is_read_and_written_with_the_same_names(tmp_path):
    part = load_structure(STORED / "part.h5", MPI.COMM_SELF)
    former = contents(STORED / "basis.h5")
    with BasisFile(STORED / "basis.h5") as basis:
        assert basis.modes == 3
        np.testing.assert_array_equal(basis.nodes, part.coordinates)
        unit = basis.displacement(np.array([1.0, 0.0, 0.0]))
        np.testing.assert_array_equal(unit, former["basis"][:, :, 0])
        assert basis.stress(np.ones(3)).shape == (8, 6)
    save_basis(tmp_path / "basis.h5", part, former["basis"].reshape(part.size, 3))
    now = contents(tmp_path / "basis.h5")
    assert set(now) == set(former) - {"stress", "stress_points"}, "the part has no elements"


class Film(Stateful):
    """A state with an attribute that has another name than its key."""

    carried = {"filled": Value("float", ("nodes",), member="sheared_fraction")}  # noqa: RUF012

    def __init__(self, nodes):
        self.sheared_fraction = np.ones(nodes)


def test_a_renamed_attribute_keeps_its_key():
    film = Film(3)
    state = film.state
    assert list(state) == ["filled"]
    other = Film(3)
    other.require_fitting(state)
    other.state = {"filled": np.zeros(3)}
    np.testing.assert_array_equal(other.sheared_fraction, np.zeros(3))
    layout = Group({"film": Group(Film.carried, member="gap")})
    assert list(layout.tree({"film": film})["film"]) == ["filled"]
    assert layout.arguments({"film": state}) == {"gap": state}
    assert Group(Film.carried).arguments(state) == {"sheared_fraction": state["filled"]}
