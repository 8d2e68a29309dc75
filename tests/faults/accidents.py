"""Kills, full disks and errors on one rank."""

import argparse
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

from attempt import Outcome, attempt, finish, launch
from judge import Verdict, figures, judge
from scene_cases import write_scene
from test_ranks import COMMAND, TOO_LONG, two_ranks
from world import COARSE, RESUME, World, command

from fenics_ehd.base import compat
from fenics_ehd.base.compile_lock import orphans

Found = Iterator[tuple[str, str, Verdict]]

NEEDED = ("long.toml", "large.toml", "rod.h5")

#: Seconds for what two ranks do, and for a run.
LIMIT = 90

#: Seconds that a film's forms take to compile, from the first file on.
COMPILING = 1.0


def _run(scene: str, every: float = 0) -> tuple[str, ...]:
    return ("run", scene, "--no-plots", "--checkpoint-every", str(every),
            "-o", "out")  # fmt: skip


def _undisturbed(
    world: World, part: str, scene: str, cache: str | None = None
) -> tuple[dict[str, object], Outcome, Path]:
    """The answer of a run that a part compares with, how it went, and its folder.

    With the name of a `cache` the run compiles its forms into this subfolder.
    """
    folder = world.folder / f"undisturbed {part}"
    world.copy(NEEDED, folder)
    call = command(*_run(scene)) if cache is None else _compiling_into(folder / cache, _run(scene))
    outcome = attempt(call, folder, LIMIT)
    if outcome.status:
        raise SystemExit(f"the undisturbed run fails: {outcome.stderr}")
    return figures(folder, outcome), outcome, folder


def _went_on(folder: Path, intact: dict[str, object]) -> Verdict:
    verdict = judge(attempt(command(*RESUME), folder, LIMIT), folder, intact)
    if verdict.word == "refused" and "no checkpoint to resume from" not in verdict.detail:
        return Verdict("loses work", verdict.detail)
    return verdict


def _folders(world: World, options: argparse.Namespace, part: str, most: int) -> Iterator[Path]:
    """Folders of a part, each with what runs need, until the deadline."""
    for number in range(max(1, round(most * options.share))):
        if time.monotonic() > options.deadline:
            return
        folder = world.folder / part / str(number)
        world.copy(NEEDED, folder)
        yield folder


def kills(world: World, options: argparse.Namespace) -> Found:
    """A run killed at random moments, and killed again after each resume."""
    intact, outcome, _ = _undisturbed(world, "kills", "long.toml")
    random = Random(f"{options.seed} kills")
    for folder in _folders(world, options, "kills", 40):
        how = random.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGKILL, signal.SIGTERM])
        calls = [_run("long.toml", random.choice([0, 0.05, 10]))] + [RESUME] * random.choice(
            [0, 0, 1]
        )
        moments = [random.uniform(0, 1.1 * outcome.seconds) for _ in calls]
        for call, moment in zip(calls, moments, strict=True):
            began = time.monotonic()
            process = launch(command(*call), folder, LIMIT)
            time.sleep(moment)
            os.kill(process, how)
            finish(process, folder, began)
        name = f"{how.name} after {', '.join(f'{m:.3f}' for m in moments)} s"
        yield "kills", name, _went_on(folder, intact)


def _compiling_into(cache: Path, arguments: tuple[str, ...]) -> Callable[[], None]:
    """A call of the command line whose forms are not those that this machine has compiled."""

    def call() -> None:
        compat.FORMS = compat._JIT["cache_dir"] = cache
        command(*arguments)()

    return call


def compilations(world: World, options: argparse.Namespace) -> Found:
    """A run killed while its forms are compiled; the next one compiles what that has left."""
    # Shape functions in a form differ in their last digit between BLAS kernels: forms that another
    # kernel compiled earlier on this machine give answers that differ by round-off.
    intact, _, _ = _undisturbed(world, "compilations", "long.toml", cache="cache")
    random = Random(f"{options.seed} compilations")
    for folder in _folders(world, options, "compilations", 10):
        cache = folder / "cache"
        began = time.monotonic()
        process = launch(_compiling_into(cache, _run("long.toml")), folder, LIMIT)
        while not list(cache.glob("*.c")) and time.monotonic() < began + LIMIT:
            time.sleep(0.01)
        moment = random.uniform(0.0, COMPILING)
        time.sleep(moment)
        os.kill(process, signal.SIGKILL)
        finish(process, folder, began)
        left = len(orphans(cache))
        call = _compiling_into(cache, (*_run("long.toml"), "--overwrite"))
        name = f"SIGKILL {moment:.3f} s after a first file, {left} not compiled to its end"
        yield "compilations", name, judge(attempt(call, folder, LIMIT), folder, intact)


def full_disk(world: World, options: argparse.Namespace) -> Found:
    """Files that may not grow further, and a file system that is full; then there is room."""
    intact, _, whole = _undisturbed(world, "disk", "large.toml")
    sizes = [p.stat().st_size for p in (whole / "out").rglob("*") if p.is_file()]
    shares = [0.7, 0.02, 0.9, 0.5, 0.2]
    for share in shares[: max(1, round(len(shares) * options.share))]:
        folder = world.folder / "disk" / str(share)
        world.copy(NEEDED, folder)
        limit = int(share * max(sizes))
        outcome = attempt(command(*_run("large.toml")), folder, LIMIT, largest_file=limit)
        yield "disk", f"no file above {limit} bytes", judge(outcome, folder, intact)
        yield "disk", f"room after {limit} bytes", _went_on(folder, intact)
        yield from _small_file_system(world, int(share * sum(sizes)), intact)


def _small_file_system(world: World, size: int, intact: dict[str, object]) -> Found:
    folder = world.folder / "disk" / f"file system of {size}"
    world.copy(NEEDED, folder)
    out = folder / "out"
    out.mkdir()

    def mount(*how: str) -> bool:
        return not subprocess.run(
            ["mount", *how, str(out)], capture_output=True, check=False
        ).returncode

    pages = max(4, size // 4096)
    if not mount("-t", "tmpfs", "-o", f"size={4 * pages}k", "tmpfs"):
        print("disk: no file system can be mounted here, skipped")
        return
    try:
        outcome = attempt(command(*_run("large.toml")), folder, LIMIT)
        yield "disk", f"file system of {4 * pages} kB", judge(outcome, folder, intact)
        mount("-o", "remount,size=64m")
        yield "disk", f"room after {4 * pages} kB", _went_on(folder, intact)
    finally:
        subprocess.run(["umount", str(out)], check=False)


#: What is wrong on one rank: what a shell does in its folder before the command, and arguments.
ONE_RANK: dict[str, tuple[str, str]] = {
    "no such scene": ("rm s.toml", ""),
    "unknown key": ("cp ../wrong.toml s.toml", ""),
    "scene is a folder": ("rm s.toml; mkdir s.toml", ""),
    "output is a folder": ("mkdir out.h5", ""),
    "basis is a folder": ("mkdir basis.h5", ""),
    "no such option": (":", "--nonsense 1"),
    "help": (":", "--help"),
    "unusable cache": ("export XDG_CACHE_HOME=/dev/null/cache HOME=/dev/null", ""),
}


def ranks(world: World, options: argparse.Namespace) -> Found:
    """An error on one of two ranks ends both."""
    folder = world.folder / "ranks"
    folder.mkdir()
    coarse = {"bodies.rod.geometry": COARSE}
    right = write_scene(folder / "right.toml", "slider-crank-paper", coarse).read_text()
    (folder / "wrong.toml").write_text(right + "[tyme]\n")
    found = [(name, rank) for name in ONE_RANK for rank in (0, 1)]
    random = Random(f"{options.seed} ranks")
    for name, rank in random.sample(found, max(2, round(len(found) * min(options.share, 1)))):
        yield "ranks", f"{name} on rank {rank}", _on_one_rank(folder, name, rank)


def _on_one_rank(folder: Path, name: str, wrong: int) -> Verdict:
    preparation, arguments = ONE_RANK[name]
    call = f"{COMMAND} reduce conrod --scene s.toml -o out.h5 --basis basis.h5"
    own = "rm -rf $RANK; mkdir $RANK; cd $RANK; cp ../right.toml s.toml"
    odd = f"{preparation}; {call} {arguments}"
    line = f"{own}; if test $RANK = {wrong}; then {odd}; else {call}; fi"
    status, message, text = two_ranks(line, folder)
    if status == TOO_LONG:
        return Verdict("hangs")
    if "Traceback" in text:
        return Verdict("traceback", text[-300:])
    if status == 0:
        # Only the first rank writes.
        return Verdict("harmless" if wrong and (folder / "0" / "out.h5").is_file() else "believed")
    if status not in (1, 2):
        return Verdict("strange status", f"{status} {text[-300:]}")
    return Verdict("refused", message[0]) if message else Verdict("no message", text[-300:])
