"""Reduced bodies in the user's cache: read bit for bit, and made again if anything is in doubt."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from subprocess import PIPE

import attrs
import numpy as np
import pytest
from calculix_ring import ring_solid, write_deck
from command_line import COMMAND, OF_THE_MACHINE, call, exit_of, start
from mpi4py import MPI
from petsc4py import PETSc
from scene_cases import write_scene
from sweep_cases import Inline

import fenics_ehd as ehd
from fenics_ehd.base.errors import OutputError
from fenics_ehd.base.progress import shown_progress
from fenics_ehd.reduction.body import body_digest
from fenics_ehd.scenes import kept_bodies, part
from fenics_ehd.scenes.part import body_counts, elastic_part, kept_entry
from fenics_ehd.study.sweep import SweepFolder, make_sweep, run_sweep

#: A coarse rod that is reduced in less than a second, and a short run.
SHORT = {
    "bodies.rod.geometry": {
        "bore_cells_around": 10, "bore_cells_along": 1, "shank_cells": 2, "small_end_layers": 1,
        "big_end_layers": 1,
    },
    "bodies.rod.reduction": {"method": "m3", "vibration_modes": 2, "residual_modes": 6},
    "time.revolutions": 0.01,
    "time.tolerance": 1e-3,
    "output.error_budget": False,
}  # fmt: skip


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Empty folder of the cache, which the command and its processes use."""
    kept_bodies.report.cache_clear()
    monkeypatch.setenv("FENICS_EHD_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def reductions(monkeypatch):
    """Methods of the reductions in this process, as they are made."""
    made = []
    reduce = part.reduce_structure

    def counted(structure, reduction):
        made.append(reduction.method)
        return reduce(structure, reduction)

    monkeypatch.setattr(part, "reduce_structure", counted)
    return made


def scene_file(folder, *changes):
    return write_scene(folder / "short.toml", "slider-crank-paper", SHORT, *changes)


def short_scene(folder, *changes):
    return ehd.read_scene(str(scene_file(folder, *changes)))


def name_of(scene, **options):
    """Name of the entry of the rod."""
    rod = scene.bodies["rod"]
    settings = rod, "bodies.rod", scene.film_element("rod"), scene.film_edges("rod")
    return kept_entry(*settings, MPI.COMM_SELF, **options).name


def files(cache):
    return sorted(path.name for path in cache.iterdir())


# --- What is read


def test_a_body_is_read_bit_for_bit_and_its_part_is_not_meshed(
    cache, tmp_path, reductions, monkeypatch
):
    scene = short_scene(tmp_path)
    announced = []
    first = ehd.build(scene, announce=lambda *names: announced.append(names))
    assert first.reduced.keys() == {"rod"}
    assert cache.stat().st_mode & 0o777 == 0o700
    assert [path.stat().st_mode & 0o777 for path in cache.iterdir()] == [0o600] * 2
    with monkeypatch.context() as patched:
        patched.setattr(part, "_assembled", None)  # nothing can be meshed
        second = ehd.build(scene, announce=lambda *names: announced.append(names))
    assert announced == [(["rod"], []), ([], ["rod"])]
    assert reductions == ["m3"]
    assert not second.reduced
    assert body_digest(first.bodies["rod"]) == body_digest(second.bodies["rod"])
    took = float(second.bodies["rod"].provenance["reduction_time_s"])
    assert second.seconds < took <= first.seconds + 1e-3
    anew = ehd.build(scene, cache=False)
    assert reductions == ["m3", "m3"]
    times = {"reduction_time_s": "", "reduction_processor_time_s": ""}
    digests = {
        body_digest(changed_provenance(machine.bodies["rod"], times)) for machine in (second, anew)
    }
    assert len(digests) == 1


def changed_provenance(body, changes):
    return replace(body, provenance={**body.provenance, **changes})


REDUCTIONS = {
    "m1": {"method": "m1", "modes": 8},
    "m3": SHORT["bodies.rod.reduction"],
    "m4": {"method": "m4", "vibration_modes": 2},
    "rigid": {"method": "rigid", "estimate_error": False},
}


@pytest.mark.parametrize("method", ["m1", "m3", "m4"])
def test_a_run_from_a_kept_body_is_that_of_a_new_reduction(cache, tmp_path, method, reductions):
    changes = {
        "bodies.rod.reduction": REDUCTIONS[method],
        "output.error_budget": True,
        "time.revolutions": 0.003,
    }
    scene = short_scene(tmp_path, changes)
    ehd.run(scene, tmp_path / "first")
    ehd.run(scene, tmp_path / "kept")
    assert reductions == [method]
    ehd.run(scene, tmp_path / "anew", cache=False)
    assert reductions == [method, method]
    for name in ("history.csv", "history.h5", "scene.toml"):
        contents = {(tmp_path / run / name).read_bytes() for run in ("first", "kept", "anew")}
        assert len(contents) == (1 if name != "history.h5" else len(contents))
    summaries = [
        json.loads((tmp_path / run / "summary.json").read_text()) for run in ("kept", "anew")
    ]
    kept, anew = ({k: v for k, v in s.items() if k not in OF_THE_MACHINE} for s in summaries)
    if method == "m4":  # a run checks its pressures only if it has the part
        for summary in (kept, anew):
            summary.pop("flexibility_errors")
            for joint in summary["joints"].values():
                joint.pop("error_budget")
                joint.pop("errors")
    assert kept == anew
    assert summaries[0]["reduction_time_s"] < summaries[1]["reduction_time_s"]


def test_a_run_from_a_kept_body_loads_no_mesher(cache, tmp_path):
    scene = scene_file(tmp_path)
    ehd.build(ehd.read_scene(str(scene)))
    lines = (
        "import sys; from fenics_ehd.cli.main import cli; "
        "cli.main(['run', sys.argv[1], '--no-plots', '-o', sys.argv[2]], standalone_mode=False); "
        "print(sorted({'gmsh', 'fenics_ehd.fem.structure', 'matplotlib'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", lines, scene, tmp_path / "run"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "reading rod from the cache" in done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


def test_a_body_with_its_mesh_error_serves_scenes_without_one(cache, tmp_path, reductions):
    complete = short_scene(tmp_path, {"output.error_budget": True})
    body = ehd.build(complete).bodies["rod"]
    assert body.mesh_flexibility.size
    plain = ehd.build(short_scene(tmp_path)).bodies["rod"]
    assert not plain.mesh_flexibility.size
    assert "flexibility_mesh_error" not in plain.accuracy
    assert reductions == ["m3"]
    shutil.rmtree(cache)
    anew = ehd.build(short_scene(tmp_path)).bodies["rod"]
    assert body_counts(plain) == body_counts(anew)
    assert body_counts(body).items() > body_counts(plain).items()
    assert ehd.build(complete).bodies["rod"].mesh_flexibility.size
    assert reductions == ["m3"] * 3


def test_fields_of_a_kept_body_are_those_of_the_part(cache, tmp_path, reductions):
    scene = short_scene(tmp_path, {"output.paraview": True})
    first, second = (ehd.build(scene).reduced["rod"] for _ in range(2))
    assert reductions == ["m3"]
    np.testing.assert_array_equal(first.columns, second.columns)
    np.testing.assert_array_equal(first.structure.coordinates, second.structure.coordinates)
    assert body_digest(first.body) == body_digest(second.body)


def test_equal_parts_of_a_scene_are_reduced_once(cache, tmp_path, reductions):
    scene = short_scene(tmp_path)
    settings = scene.bodies["rod"]
    entry = kept_entry(settings, "bodies.rod", "lagrange", {}, MPI.COMM_SELF)
    both = [
        elastic_part(settings, "bodies.rod", "lagrange", MPI.COMM_SELF, {}, entry) for _ in range(2)
    ]
    first, second = (each.reduce() for each in both)
    assert reductions == ["m3"]
    assert body_digest(first.body) == body_digest(second.body)


# --- What a body depends on


@pytest.mark.parametrize(
    "changes",
    [
        {"bodies.rod.geometry.rod_length": 0.16001},
        {"bodies.rod.geometry.bore_cells_along": 2},
        {"bodies.rod.material.density": 7851.0},
        {"bodies.rod.element": "lagrange"},
        {"bodies.rod.cells": "tet"},
        {"bodies.rod.reduction.vibration_modes": 3},
        {"bodies.rod.reduction": REDUCTIONS["m1"]},
        {"bodies.rod.reduction.estimate_error": False},
        {"bodies.rod.reduction.solver": "iterative"},
        {"joints.big_end.element": "serendipity"},
        {"joints.big_end.supply.inlet": {"kind": "circumferential-groove", "width": 2e-3}},
    ],
    ids=str,
)
def test_a_changed_setting_of_the_body_is_another_address(cache, tmp_path, changes):
    assert name_of(short_scene(tmp_path)) != name_of(short_scene(tmp_path, changes))


def test_other_settings_of_a_scene_leave_the_address(cache, tmp_path):
    changes = {
        "bodies.rod.damping_time": 2e-3,
        "joints.big_end.clearance": 20e-6,
        "time.tolerance": 1e-4,
    }
    assert name_of(short_scene(tmp_path)) == name_of(short_scene(tmp_path, changes))


@pytest.mark.parametrize(
    ("function", "value"),
    [
        ("blas_kernels", ["OpenBLAS 0.3.21 Haswell threads=1"]),
        ("_sources", "of another day"),
        ("_versions", {"gmsh": "4.99"}),
        ("_instruction_sets", "flags : sse2"),
    ],
)
def test_another_kernel_source_or_version_is_another_address(
    cache, tmp_path, monkeypatch, function, value
):
    scene = short_scene(tmp_path)
    before = name_of(scene)
    monkeypatch.setattr(kept_bodies, function, lambda: value)
    assert name_of(scene) != before


def test_every_source_counts(monkeypatch, tmp_path):
    package = Path(kept_bodies.__file__).parents[1]
    shutil.copytree(package, tmp_path / "fenics_ehd")
    copy = tmp_path / "fenics_ehd" / "scenes" / "kept_bodies.py"
    monkeypatch.setattr(kept_bodies, "__file__", str(copy))
    sources = kept_bodies._sources.__wrapped__
    before = sources()
    assert before == kept_bodies._sources()
    for name in ("reduction/static.py", "fem/structure.py", "base/compat.py", "scenes/part.py"):
        with open(tmp_path / "fenics_ehd" / name, "a") as file:
            file.write("\n# a comment\n")
        after = sources()
        assert after != before
        before = after


def test_options_of_petsc_count(cache, tmp_path):
    scene = short_scene(tmp_path)
    before = name_of(scene)
    PETSc.Options()["static_mat_mumps_icntl_7"] = 5
    try:
        assert name_of(scene) != before
    finally:
        PETSc.Options().delValue("static_mat_mumps_icntl_7")
    assert name_of(scene) == before


def test_the_kernel_of_the_process_is_named():
    kernels = {text for text in kept_bodies.blas_kernels() if text.startswith("OpenBLAS")}
    assert kernels  # one of Debian; NumPy, SciPy and PETSc of PyPI contain their own
    assert all(kernel.endswith("threads=1") for kernel in kernels)


def test_names_depend_on_bodies_that_the_reductor_reduced_before(cache, tmp_path):
    scene = short_scene(tmp_path)
    assert len({name_of(scene), name_of(scene, after=["a"]), name_of(scene, after=["b"])}) == 3
    assert name_of(scene, mesh_error=True) != name_of(scene)
    assert name_of(scene, cache=False) == ""


def test_a_model_changed_by_a_byte_is_another_address(cache, tmp_path):
    shutil.copy(ehd.model_path("conrod"), tmp_path / "rod.geo")
    scene = short_scene(tmp_path, {"bodies.rod.model": str(tmp_path / "rod.geo")})
    before = name_of(scene)
    content = (tmp_path / "rod.geo").read_bytes()
    (tmp_path / "rod.geo").write_bytes(content + b"\n")
    assert name_of(scene) != before
    (tmp_path / "rod.geo").write_bytes(content)
    assert name_of(scene) == before


def test_a_part_of_another_program_changed_by_a_byte_is_another_address(cache, tmp_path):
    part_file, model = tmp_path / "ring.inp", tmp_path / "ring.msh"
    solid = ring_solid("tet")
    write_deck(part_file, solid, np.arange(1, len(solid.points) + 1))
    content = part_file.read_bytes()
    at = content.index(b"\n", content.upper().index(b"*NODE")) + 1
    coordinate = re.compile(rb"\.\d*?(\d)(?=e|,|\s)").search(content, at)
    digit = coordinate.start(1)
    changed = bytearray(content)
    changed[digit] = ord("1") if changed[digit] != ord("1") else ord("2")
    rod = ehd.read_scene("slider-crank-paper").bodies["rod"]
    rod = attrs.evolve(rod, model=str(model), geometry={}, points=())
    names = []
    for text in (content, bytes(changed), content):
        part_file.write_bytes(text)
        assert (
            call("part", part_file, "--unit", "m", "--bore", "20mm", "--no-check", "-o", model) == 0
        )
        names.append(kept_entry(rod, "bodies.rod", "lagrange", {}, MPI.COMM_SELF).name)
    assert names[0] == names[2] != names[1]


def test_a_model_that_reads_other_files_is_not_kept(cache, tmp_path, capfd):
    model = tmp_path / "rod.geo"
    model.write_text('Include "conrod.geo";\n')
    shutil.copy(ehd.model_path("conrod"), tmp_path / "conrod.geo")
    scene = short_scene(tmp_path, {"bodies.rod.model": str(model)})
    assert name_of(scene) == ""
    assert f"{model} may depend on more than its content: it has Include" in capfd.readouterr().err


# --- Entries that cannot be used


def cut(path):
    path.write_bytes(path.read_bytes()[:-1000])


def alter(path):
    content = bytearray(path.read_bytes())
    content[-1000] ^= 1
    path.write_bytes(content)


def empty(path):
    path.write_bytes(b"")


def link(path):
    shutil.move(path, path.with_name("elsewhere"))
    path.symlink_to(path.with_name("elsewhere"))


def open_to_all(path):
    path.chmod(0o666)


def other_body(path):
    """The file of an entry under the name of another one."""
    body = ehd.load_body(path)
    ehd.save_body(changed_provenance(body, {"method": "m1"}), path)


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """Folder of a cache that has the body of the short scene; it is copied, not changed."""
    folder = tmp_path_factory.mktemp("filled")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("FENICS_EHD_CACHE", str(folder / "cache"))
        ehd.build(short_scene(folder))
    return folder / "cache"


@pytest.mark.parametrize("damage", [cut, alter, empty, link, open_to_all, other_body])
def test_a_damaged_body_is_made_again(cache, filled, tmp_path, reductions, damage):
    shutil.copytree(filled, cache)
    scene = short_scene(tmp_path)
    first = ehd.build(scene).bodies["rod"]
    assert reductions == []
    name = name_of(scene)
    damage(cache / f"{name}.h5")
    ehd.build(scene)
    assert reductions == ["m3"]
    again = ehd.build(scene).bodies["rod"]
    assert reductions == ["m3"]
    times = {"reduction_time_s": "", "reduction_processor_time_s": ""}
    assert body_digest(changed_provenance(again, times)) == body_digest(
        changed_provenance(first, times)
    )


@pytest.mark.parametrize("damage", [cut, alter, Path.unlink])
def test_a_damaged_basis_is_made_again(cache, filled, tmp_path, reductions, capfd, damage):
    shutil.copytree(filled, cache)
    scene = short_scene(tmp_path, {"output.paraview": True})
    ehd.build(scene)
    assert reductions == []
    basis = cache / f"{name_of(scene)}.basis.h5"
    damage(basis)
    assert "cannot be used" not in capfd.readouterr().err
    ehd.build(scene)
    assert f"{basis} cannot be used: reduced anew" in capfd.readouterr().err
    assert reductions == ["m3"]
    ehd.build(scene)
    assert reductions == ["m3"]


def of_another_user(cache):
    cache.mkdir()
    os.chown(cache, 12345, 12345)


def writable_by_others(cache):
    cache.mkdir()
    cache.chmod(0o777)


def a_file(cache):
    cache.write_text("")


def unreachable(cache):
    cache.symlink_to("/proc/self/missing")


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        pytest.param(
            of_another_user,
            "it belongs to user 12345",
            marks=pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away"),
        ),
        (writable_by_others, "others can write to it"),
        (a_file, "File exists"),
        (unreachable, ""),
    ],
)
def test_a_folder_that_cannot_be_trusted_is_not_used(
    cache, tmp_path, reductions, capfd, fault, reason
):
    fault(cache)
    scene = short_scene(tmp_path)
    ehd.build(scene)
    ehd.build(scene)
    assert reductions == ["m3", "m3"]
    lines = [line for line in capfd.readouterr().err.splitlines() if "not kept" in line]
    assert len(lines) == 1
    assert reason in lines[0]
    assert not cache.is_dir() or not any(cache.iterdir())


def test_a_user_without_a_home_folder_has_no_cache(monkeypatch, capfd):
    kept_bodies.report.cache_clear()
    for name in ("HOME", "XDG_CACHE_HOME", "FENICS_EHD_CACHE"):
        monkeypatch.delenv(name, raising=False)

    def missing():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", missing)
    status, out, err = exit_of(capfd, "info", "--cache")
    assert (status, out) == (0, "no folder of reduced bodies is used\n")
    assert "reduced bodies are not kept: user " in err
    assert "has no home folder: set HOME" in err


def test_a_relative_path_of_the_cache_is_reported(monkeypatch, tmp_path, capfd):
    kept_bodies.report.cache_clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("FENICS_EHD_CACHE", "some/folder")
    assert kept_bodies.folder() == tmp_path / "fenics_ehd"
    err = capfd.readouterr().err
    assert f"FENICS_EHD_CACHE = some/folder is not an absolute path: {tmp_path}" in err


def test_a_folder_that_others_can_read_is_closed(cache, tmp_path, reductions):
    cache.mkdir(mode=0o755)
    ehd.build(short_scene(tmp_path))
    assert cache.stat().st_mode & 0o777 == 0o700


@pytest.mark.skipif(os.geteuid() == 0, reason="root can write to all folders")
def test_a_read_only_folder_is_read(cache, tmp_path, reductions):
    ehd.build(short_scene(tmp_path))
    cache.chmod(0o500)
    ehd.build(short_scene(tmp_path))
    ehd.build(short_scene(tmp_path, {"bodies.rod.reduction.vibration_modes": 3}))
    cache.chmod(0o700)
    assert reductions == ["m3", "m3"]


@pytest.mark.parametrize("name", ["save_body", "_lock"])
def test_a_full_disk_fails_no_run(cache, tmp_path, reductions, monkeypatch, capfd, name):
    def full(*_):
        raise OutputError("the cache: No space left on device")

    monkeypatch.setattr(kept_bodies, name, full if name == "save_body" else lambda _: None)
    ehd.build(short_scene(tmp_path))
    assert reductions == ["m3"]
    assert len(files(cache)) == (2 if name == "_lock" else 0)
    assert ("No space left" in capfd.readouterr().err) == (name == "save_body")


# --- Size


def test_the_least_recently_used_entries_are_removed(cache, tmp_path, reductions, monkeypatch):
    scenes = [
        short_scene(tmp_path, {"bodies.rod.material.density": density})
        for density in (7800.0, 7810.0, 7820.0, 7830.0)
    ]
    for scene in scenes[:3]:
        ehd.build(scene)
    entries = kept_bodies.stored(cache)
    for age, name in zip((300, 200, 100), map(name_of, scenes), strict=False):
        for path in cache.glob(f"{name}*"):
            os.utime(path, (time.time() - age,) * 2)
    ehd.build(scenes[0])  # its last use is now
    size = sum(entry.size for entry in entries)
    monkeypatch.setattr(kept_bodies, "LARGEST_SIZE", size + 1000)
    ehd.build(scenes[3])
    assert {entry.name for entry in kept_bodies.stored(cache)} == {
        name_of(scene) for scene in (scenes[0], scenes[2], scenes[3])
    }
    monkeypatch.setattr(kept_bodies, "LARGEST_SIZE", 10)
    ehd.build(scenes[1])
    assert files(cache) == []


def test_abandoned_files_count_and_foreign_ones_stay(cache):
    kept_bodies.folder()
    abandoned, fresh = (cache / f"{digit * 32}.h5.part" for digit in "ab")
    for path in (abandoned, fresh, cache / "notes.txt"):
        path.write_bytes(bytes(100))
    os.utime(abandoned, (0, 0))
    assert [entry.name for entry in kept_bodies.stored(cache)] == ["a" * 32]
    kept_bodies.trim(cache, 0)
    assert files(cache) == [fresh.name, "notes.txt"]


# --- Several processes


def test_two_processes_reduce_a_part_once(cache, tmp_path):
    scene = scene_file(tmp_path)
    arguments = [["reduce", "rod", "--scene", scene, "-o", tmp_path / f"{i}.h5"] for i in (0, 1)]
    both = [start(each, stderr=PIPE) for each in arguments]
    errors = [process.communicate(timeout=300)[1].decode() for process in both]
    assert [process.returncode for process in both] == [0, 0], errors
    bodies = [ehd.load_body(tmp_path / f"{i}.h5") for i in (0, 1)]
    # The time of the reduction is the same: there was one.
    assert body_digest(bodies[0]) == body_digest(bodies[1])
    assert len(files(cache)) == 2


def test_the_lock_of_a_killed_process_holds_no_other(cache, tmp_path, reductions):
    scene = short_scene(tmp_path)
    kept_bodies.folder()
    (cache / f"{name_of(scene)}.lock").touch()
    ehd.build(scene)
    assert reductions == ["m3"]
    assert not any(name.endswith(".lock") for name in files(cache))


def test_another_process_that_hangs_is_not_waited_for(
    cache, tmp_path, reductions, monkeypatch, capfd
):
    scene = short_scene(tmp_path)
    monkeypatch.setattr(kept_bodies, "NOTICE", 0.0)
    monkeypatch.setattr(kept_bodies, "LONGEST_WAIT", 0.5)
    kept_bodies.folder()
    held = kept_bodies._lock(cache / f"{name_of(scene)}.lock")
    ehd.build(scene)
    os.close(held)
    assert reductions == ["m3"]
    assert "waiting for another process" in capfd.readouterr().err


@pytest.mark.mpi
def test_ranks_agree_on_a_kept_body(monkeypatch):
    comm = MPI.COMM_WORLD
    folder = comm.bcast(f"/tmp/fenics-ehd-kept-{os.getpid()}")
    monkeypatch.setenv("FENICS_EHD_CACHE", folder)
    rod = ehd.read_scene("slider-crank-paper").bodies["rod"]
    reduction = attrs.evolve(rod.reduction, method="m3", residual_modes=6, estimate_error=False)
    rod = attrs.evolve(rod, geometry=SHORT["bodies.rod.geometry"], reduction=reduction)
    try:
        made = []
        for _ in range(2):
            entry = kept_entry(rod, "bodies.rod", "lagrange", {}, comm)
            made.append(elastic_part(rod, "bodies.rod", "lagrange", comm, {}, entry).reduce())
        first, second = made
        assert body_digest(first.body) == body_digest(second.body)
        np.testing.assert_array_equal(first.columns, second.columns)
        names = comm.allgather(entry.name)
        assert len(set(names)) == 1
        alone = kept_entry(rod, "bodies.rod", "lagrange", {}, MPI.COMM_SELF).name
        assert (alone == names[0]) == (comm.size == 1)
    finally:
        comm.barrier()
        if comm.rank == 0:
            shutil.rmtree(folder)


# --- Commands


def test_commands_report_what_they_read(cache, tmp_path, capfd, reductions):
    scene = scene_file(tmp_path)
    reduce = ["reduce", "rod", "--scene", scene, "-o", tmp_path / "rod.h5", "--json"]
    basis = ["--basis", tmp_path / "basis.h5"]
    lines = []
    spent = []
    for more in ([], [], basis, ["--no-cache"]):
        status, out, err = exit_of(capfd, *reduce, *more)
        assert status == 0
        lines.append(err.strip().removeprefix("reducing rod (forms"))
        spent.append(json.loads(out)["reduction_time_s"])
    reading = "reading rod from the cache (--no-cache reduces anew)"
    assert lines == ["reducing rod", reading, reading, "reducing rod"]
    assert reductions == ["m3", "m3"]
    assert max(spent[1], spent[2]) < min(spent[0], spent[3])
    assert (tmp_path / "basis.h5").is_file()
    assert "FENICS_EHD_CACHE" in os.environ
    run = ["run", scene, "--no-plots", "-o", tmp_path / "run"]
    assert exit_of(capfd, *run)[2].startswith(reading)
    stress = ["stress", tmp_path / "run", "--json"]
    first = exit_of(capfd, *stress)
    assert (first[0], first[2].strip()) == (0, reading)
    other = exit_of(capfd, *stress, "--no-cache")
    assert other[2].strip() == "reducing rod"
    assert json.loads(first[1])["bodies"] == json.loads(other[1])["bodies"]
    assert reductions == ["m3"] * 3


def test_the_cache_is_listed_and_cleared(cache, tmp_path, capfd, reductions):
    scene = short_scene(tmp_path)
    assert json.loads(exit_of(capfd, "info", "--cache", "--json")[1])["bodies"] == []
    ehd.build(scene)
    ehd.build(short_scene(tmp_path, {"bodies.rod.reduction": REDUCTIONS["rigid"]}))
    alter(cache / f"{name_of(scene)}.h5")
    listed = json.loads(exit_of(capfd, "info", "--cache", "--json")[1])
    assert listed["folder"] == str(cache)
    assert {body["method"] for body in listed["bodies"]} == {"damaged", "rigid"}
    assert listed["size_bytes"] == sum(path.stat().st_size for path in cache.iterdir())
    text = exit_of(capfd, "info", "--cache")[1]
    assert f"reduced bodies in {cache}: 2, with" in text
    assert re.search(r"rigid, 0 modes +conrod\.geo +reduced in", text)
    assert exit_of(capfd, "info", "--cache", "--clear")[:2] == (
        0, f"reduced bodies removed from {cache}: 2, with {listed['size_bytes'] / 2**20:.1f} MB\n",
    )  # fmt: skip
    assert files(cache) == []
    assert call("info", "--clear") == 2


def test_sweeps_in_different_folders_share_bodies(cache, tmp_path, capfd, reductions):
    scene = str(scene_file(tmp_path))
    plan = make_sweep(scene, ["residual_modes=4,6", "damping_time=1e-3,2e-3"])
    tables = []
    for name in ("one", "two"):
        with SweepFolder(tmp_path / name, plan) as folder:
            run_sweep(folder, Inline(), progress=shown_progress(logs=True))
        tables.append((tmp_path / name / "sweep.csv").read_text())
    assert reductions == ["m3", "m3"]
    err = capfd.readouterr().err
    assert "reduced bodies: 2 made, 0 read from the cache" in err
    assert "reduced bodies: 0 made, 2 read from the cache" in err
    one, two = ({path.name: ehd.load_body(path) for path in (tmp_path / name / "bodies").iterdir()}
                for name in ("one", "two"))  # fmt: skip
    assert {name: body_digest(body) for name, body in one.items()} == {
        name: body_digest(body) for name, body in two.items()
    }
    # The first body of a part is that of a run.
    ehd.build(short_scene(tmp_path))
    assert reductions == ["m3", "m3"]


def test_help_names_the_option():
    for command in ("run", "reduce", "stress", "sensitivity", "sweep", "study"):
        assert COMMAND
        assert "--no-cache" in _help(command)


def _help(command):
    from click.testing import CliRunner

    from fenics_ehd.cli.main import cli

    return CliRunner().invoke(cli, [command, "--help"]).output
