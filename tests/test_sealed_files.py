"""Bodies, checkpoints, parts and bases that changed since they were written, or are impossible."""

import errno
import os
import resource
import subprocess
import sys
import time
from dataclasses import replace

import h5py
import numpy as np
import pytest
from foreign_parts import ring
from hand_made_rod import Joint, flexible
from mpi4py import MPI

import fenics_ehd as ehd
from fenics_ehd.base import files as whole_file
from fenics_ehd.base import sealed_file
from fenics_ehd.base.columns import Quantity
from fenics_ehd.base.sealed_file import seal
from fenics_ehd.reduction.body import body_digest
from fenics_ehd.reduction.matrices import as_matrix
from fenics_ehd.reduction.part_files import BasisFile, load_structure, save_basis, save_structure

TREE = {"rows": 3, "state": {"x": np.arange(12.0).reshape(4, 3), "name": "m4", "none": {}}}


def small_history():
    """Of one step."""
    values = {"time": Quantity([0.0], "s"), "run/step": Quantity([1.0], "s")}
    values |= {
        f"state/{kind}": Quantity(np.zeros((1, 2)), "1") for kind in ("coordinates", "rates")
    }
    return ehd.History(values, ("bodies/a/x", "bodies/a/y"), ("m", "m"))


def write_part(path):
    save_structure(ring(comm=MPI.COMM_SELF), path)


def write_basis(path):
    part = ring(comm=MPI.COMM_SELF)
    save_basis(path, part, np.random.default_rng(1).standard_normal((part.size, 3)))


#: A history has no other name in its folder.
FILE = "history.h5"

KINDS = {
    "body": (
        lambda path: ehd.save_body(flexible(Joint())[0], path),
        ehd.load_body,
        ehd.errors.BodyFileError,
    ),
    "history": (
        lambda path: small_history().write(path, state=TREE),
        lambda path: ehd.load_history(path.parent),
        ehd.errors.InputError,
    ),
    "part": (
        write_part,
        lambda path: load_structure(path, MPI.COMM_SELF),
        ehd.errors.StructureError,
    ),
    "basis": (write_basis, lambda path: BasisFile(path).close(), ehd.errors.BodyFileError),
}


def refused(kind, path):
    """The message of the one line by which a file is refused."""
    with pytest.raises(KINDS[kind][2]) as caught:
        KINDS[kind][1](path)
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_one_bit_anywhere_is_found(kind, tmp_path):
    path = tmp_path / FILE
    KINDS[kind][0](path)
    KINDS[kind][1](path)
    whole = path.read_bytes()
    places = np.random.default_rng(7).integers(len(whole), size=60)
    for place in (20, 600, *places.tolist(), len(whole) - 1):
        spoiled = bytearray(whole)
        spoiled[place] ^= 1 << (place % 8)
        path.write_bytes(spoiled)
        assert "the digest does not match the content" in refused(kind, path)


@pytest.mark.parametrize("kind", KINDS)
def test_what_hdf5_changed_or_cut_off_is_found(kind, tmp_path):
    path = tmp_path / FILE
    KINDS[kind][0](path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    assert "the digest does not match the content" in refused(kind, path)
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        file.attrs["note"] = "harmless"
    assert "the digest does not match the content" in refused(kind, path)
    seal(path, path)
    KINDS[kind][1](path)


@pytest.mark.parametrize("kind", KINDS)
def test_a_pipe_is_not_waited_for(kind, tmp_path):
    os.mkfifo(tmp_path / FILE)
    assert "not a regular file" in refused(kind, tmp_path / FILE)


@pytest.mark.parametrize("kind", ["body", "history", "basis"])
def test_a_file_without_a_digest_is_refused(kind, tmp_path):
    path = tmp_path / FILE
    KINDS[kind][0](path)
    path.write_bytes(path.read_bytes()[512:])
    assert "the file has no digest: " in refused(kind, path)


def test_a_link_in_place_of_a_part_file_is_not_followed(tmp_path):
    precious = tmp_path / "precious"
    precious.write_text("mine")
    for kind, (write, read, _) in KINDS.items():
        path = tmp_path / kind / FILE
        path.parent.mkdir()
        path.with_name(f"{FILE}.part").symlink_to(precious)
        write(path)
        read(path)
    assert precious.read_text() == "mine"


@pytest.mark.parametrize("kind", KINDS)
def test_two_that_write_one_file_at_a_time_both_write_it_whole(kind, tmp_path, monkeypatch):
    """The second begins and ends as the first is about to put its file in place."""
    path, put = tmp_path / FILE, whole_file.put_in_place

    def after_another(partial, target):
        monkeypatch.undo()
        KINDS[kind][0](path)
        KINDS[kind][1](path)
        put(partial, target)

    for module in (whole_file, sealed_file):
        monkeypatch.setattr(module, "put_in_place", after_another)
    KINDS[kind][0](path)
    KINDS[kind][1](path)
    assert [p.name for p in tmp_path.iterdir()] == [FILE]


def test_the_digest_of_a_body_is_that_of_its_numbers(tmp_path):
    body, *_ = flexible(Joint())
    ehd.save_body(body, tmp_path / "rod.h5")
    again = ehd.load_body(tmp_path / "rod.h5")
    assert body_digest(again) == body_digest(body)
    assert body_digest(replace(again, stiffness=np.nextafter(body.stiffness, 1e9))) != (
        body_digest(body)
    )


# Sealed, and wrong all the same


def forged(path, change):
    with h5py.File(path, "r+") as file:
        change(file)
    seal(path, path)


def put(name, value):
    def change(file):
        del file[name]
        file[name] = value

    return change


def claim(file):
    del file["stiffness"]
    file.create_dataset("stiffness", (10**6, 10**6), "f8", chunks=(100, 100))


WRONG = {
    "complex": (put("stiffness", np.eye(4) * 1j), "/stiffness holds complex128, not numbers"),
    "empty": (put("mass", h5py.Empty("f8")), "/mass is no array"),
    "compound": (put("mass", np.zeros(3, dtype=[("a", "f8")])), "/mass holds"),
    "group": (put("inertia", 1.0), "/inertia is no group"),
    "missing": (lambda file: file.pop("bores/bore/radius"), "/bores/bore/radius is missing"),
    "short inventory": (
        put("inventory/dropped", np.array([b"why"] * 3)),
        "/inventory/dropped has shape (3,), not (0,)",
    ),
    "claim": (claim, "/stiffness declares 8000000000000 bytes, but its file can"),
    "soft loop": (put("mass", h5py.SoftLink("/mass")), "too many links"),
    "hard loop": (
        lambda file: file.__setitem__("points/all", file["/"]),
        "/points/all is no array",
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_file_of_its_kind_is_named(kind, tmp_path):
    path = tmp_path / FILE
    refused(kind, path)  # which is not there
    KINDS[kind][0](path)
    forged(path, lambda file: file.attrs.update(format_version=99))
    assert "format version 99, but this program reads" in refused(kind, path)
    forged(path, lambda file: file.attrs.update(format="something"))
    assert "not a fenics_ehd" in refused(kind, path)
    path.write_text("nodes")
    assert "signature" in refused(kind, path)


@pytest.mark.parametrize("case", WRONG)
def test_a_body_of_other_contents_is_named(case, tmp_path):
    change, message = WRONG[case]
    path = tmp_path / "rod.h5"
    ehd.save_body(flexible(Joint())[0], path)
    forged(path, change)
    assert message in refused("body", path)


def external(file):
    file.create_dataset("more/out", (4,), "f8", external=[("secret", 0, 32)])


def virtual(file):
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (4,))
    file.create_virtual_dataset("more/out", layout)


def link(file):
    file["more/out"] = h5py.ExternalLink("other.h5", "/x")


@pytest.mark.parametrize("change", [external, virtual, link], ids=lambda change: change.__name__)
@pytest.mark.parametrize("kind", [*KINDS, "matrix"])
def test_what_lies_in_another_file_is_not_followed(kind, change, tmp_path):
    """Nor is it read from files that another program may have written, and that have no digest."""
    path = tmp_path / FILE
    message = "more/out are in another file"
    if kind in KINDS:
        KINDS[kind][0](path)
        forged(path, change)
        assert message in refused(kind, path)
        return
    with h5py.File(path, "w") as file:
        change(file)
        file["shape"] = (3, 3)
    with pytest.raises(ehd.errors.StructureError, match=message):
        as_matrix(str(path), MPI.COMM_SELF, "stiffness")


@pytest.mark.parametrize("kind", ["body", "history"])
def test_a_full_disk_keeps_the_former_file_and_leaves_no_other(kind, tmp_path, monkeypatch):
    def fail(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / FILE
    KINDS[kind][0](path)
    former = path.read_bytes()
    with monkeypatch.context() as full:
        full.setattr(os, "fsync", fail)
        with pytest.raises(ehd.errors.OutputError, match=r"history\.h5: No space left"):
            KINDS[kind][0](path)
    assert path.read_bytes() == former
    assert [p.name for p in tmp_path.iterdir()] == [FILE]


def test_a_part_that_the_disk_has_no_room_for_is_named(tmp_path):
    # After MPI has begun, which has files of its own.
    code = """if True:
        import resource, sys
        from pathlib import Path
        from test_sealed_files import KINDS
        from fenics_ehd.base.errors import InputError
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
        for kind in ("part", "basis"):
            try:
                KINDS[kind][0](Path(sys.argv[1], kind))
            except InputError as error:
                print(error)"""
    found = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        capture_output=True, text=True, timeout=120,
        env=os.environ | {"PYTHONPATH": os.path.dirname(__file__)},
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    reported = found.stdout.splitlines()
    for kind, line in zip(("part", "basis"), reported, strict=True):
        assert str(tmp_path / kind) in line
        assert "File too large" in line
    assert not list(tmp_path.iterdir())


# Small and endless


def doubled(file, place):
    """A path of 2^22 ways through 22 groups."""
    group = file.require_group(place)
    for _ in range(22):
        next_group = group.create_group("one")
        group["other"] = next_group
        group = next_group


def to_the_root(file, place):
    file.require_group(place)["all"] = h5py.SoftLink("/")


def bombs(file, place):
    """Shapes of 16 MB each of which no byte is stored."""
    group = file.require_group(place)
    for number in range(300):
        group.create_dataset(f"x{number}", (2**21,), "f8", chunks=(2**16,), compression="gzip")


#: A group of each kind whose members have any names.
PLACES = {"body": "accuracy", "history": "run", "part": "attachments", "basis": "more"}


@pytest.mark.parametrize("change", [doubled, to_the_root, bombs], ids=lambda f: f.__name__)
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_small_and_endless_is_refused_at_once(kind, change, tmp_path):
    path = tmp_path / FILE
    KINDS[kind][0](path)
    forged(path, lambda file: change(file, PLACES[kind]))
    began, memory = time.monotonic(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused(kind, path)
    assert time.monotonic() - began < 10
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory < 200_000  # kB


def test_a_matrix_that_is_packed_away_is_refused(tmp_path):
    path = tmp_path / "k.h5"
    with h5py.File(path, "w") as file:
        file["shape"] = (3, 3)
        file["indptr"] = np.arange(4)
        for name, kind in (("data", "f8"), ("indices", "i4")):
            file.create_dataset(name, (10**9,), kind, chunks=(10**6,), compression="gzip")
    with pytest.raises(ehd.errors.StructureError, match="declares 4000000000 bytes"):
        as_matrix(str(path), MPI.COMM_SELF, "stiffness")


def test_text_that_many_share_is_not_read_many_times(tmp_path):
    """All of 60 000 texts lie in one place of the file."""
    path = tmp_path / "rod.h5"
    ehd.save_body(flexible(Joint())[0], path)

    def share(file):
        names = ["kind", "dropped"]
        for name in names:
            del file[f"inventory/{name}"]
            file[f"inventory/{name}"] = np.array(["x" * 60_000] + [""] * 9_999, h5py.string_dtype())
        for name in ("frequency", "participation"):
            del file[f"inventory/{name}"]
            file[f"inventory/{name}"] = np.zeros(10_000)

    forged(path, share)
    content = path.read_bytes()
    # Where texts are: references of 16 bytes, the first of which all others become.
    with h5py.File(path) as file:
        place = file["inventory/kind"].id.get_offset()
    first = content[place : place + 16]
    path.write_bytes(content[:place] + first * 10_000 + content[place + 160_000 :])
    seal(path, path)
    assert "/inventory/kind has more characters than its file has bytes" in refused("body", path)
