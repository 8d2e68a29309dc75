"""Names that need quotes, folders of other people, links in them, limits."""

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

from cases import Case
from world import CALLS, RESUME, RUN, World, command

#: Names of a point, and of folders.
NAMES = ("hook left", "größe", "a.b", '"', "'", "\\", "#", "]", "=", "\t", "\x7f", "😀", "日本")
FOLDERS = (*NAMES, "..x", " ", "a\nb", "~", "$HOME", "%s", "{}", "x" * 200)


def _text(name: str) -> str:
    """As TOML has it in quotes."""
    escaped = "".join(f"\\u{ord(c):04x}" if c in '"\\\t\n\x7f' else c for c in name)
    return f'"{escaped}"'


def names(world: World, random: Random) -> Iterator[Case]:
    """Points and folders by every name: the answer is that of the intact run."""
    needed, _ = CALLS["run"]

    def points(name: str) -> Callable[[Path], None]:
        def prepare(folder: Path) -> None:
            world.copy(needed, folder)
            text = (folder / "scene.toml").read_text()
            text = text.replace("bodies.crank.points.pin", f"bodies.crank.points.{_text(name)}")
            text = text.replace('"crank.pin"', _text(f"crank.{name}"))
            (folder / "scene.toml").write_text(text)

        return prepare

    def within(name: str) -> Callable[[Path], None]:
        def prepare(folder: Path) -> None:
            folder.mkdir(parents=True)
            world.copy(needed, folder / name)

        return prepare

    found = [("point", name) for name in NAMES] + [("folder", name) for name in FOLDERS]
    for kind, name in random.sample(found, len(found)):
        place = f"./{name}/scene.toml" if kind == "folder" else "scene.toml"
        prepare = within(name) if kind == "folder" else points(name)
        call = command("run", place, *RUN[2:])
        yield Case("names", f"{kind} {name[:20]!r}", prepare, call, intact="run")


#: What may be in a folder that results shall go to; a slash behind a folder.
OTHERS = ("scene.toml", "body-rod.h5", "rod.h5", "history.csv", "history.h5", "summary.json",
          "manifest.txt", "orbit.png", "orbit-notes.svg",
          "animation.pptx", "stress.json", ".lock", "vtk/", "replacement/", ".run-backup/",
          ".moving-a1/", ".ended-x/", "runs/", "figures/")  # fmt: skip


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _untouched(call: Callable[[], None], *folders: str) -> Callable[[], None]:
    """A call after which every file of these folders must be what it was."""

    def whole() -> None:
        before = [_contents(Path(folder)) for folder in folders]
        try:
            call()
        finally:
            for folder, files in zip(folders, before, strict=True):
                left = _contents(Path(folder))
                lost = [name for name, content in files.items() if left.get(name) != content]
                if lost:
                    raise RuntimeError(f"touched {lost}")

    return whole


def folders(world: World, random: Random) -> Iterator[Case]:
    """Files of the user's where the results shall go."""
    needed, _ = CALLS["run"]

    def prepare(chosen: list[str]) -> Callable[[Path], None]:
        def write(folder: Path) -> None:
            world.copy(needed, folder)
            for name in chosen:
                path = folder / "out" / (f"{name}mine" if name[-1] == "/" else name)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text("mine")

        return write

    calls = {"run": RUN, "overwrite": (*RUN, "--overwrite"), "resume": RESUME}
    found = [([name], call) for name in OTHERS for call in calls]
    for chosen, name in random.sample(found, len(found)):
        call = _untouched(command(*calls[name]), "out")
        yield Case("folders", f"{name} {chosen}", prepare(chosen), call, intact="run")
    while True:
        chosen, name = random.sample(OTHERS, 5), random.choice(list(calls))
        call = _untouched(command(*calls[name]), "out")
        yield Case("folders", f"{name} {chosen}", prepare(chosen), call, intact="run")


def links(world: World, random: Random) -> Iterator[Case]:
    """A stopped run of somebody else, with links out of its folder and lists that name them."""
    needed, _ = CALLS["resume"]

    def prepare(name: str, manifest: str) -> Callable[[Path], None]:
        def write(folder: Path) -> None:
            world.copy(needed, folder)
            shutil.copytree(folder / "out", folder / "elsewhere")
            path = folder / "out" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            target = folder / "elsewhere" / path.name
            path.unlink(missing_ok=True)
            path.symlink_to(target if target.is_file() else folder / "elsewhere")
            with open(folder / "elsewhere" / "manifest.txt", "a") as file:
                file.write("\nmine\n")
            (folder / "elsewhere" / "mine").write_text("mine")
            if name != "manifest.txt":
                with open(folder / "out" / "manifest.txt", "a") as file:
                    file.write(manifest)

        return write

    places = ("manifest.txt", "history.h5", "history.csv",
              "summary.json", "vtk", "replacement", "replacement/vtk", "runs", "figures",
              ".moving-a1/d", ".ended-x", ".run-y")  # fmt: skip
    lists = ("", "\nvtk/\nreplacement/\nruns/\nfigures/\n", "\n../elsewhere/mine\n", "\nvtk/mine\n",
             "\n/etc/passwd\n", "\n..\n", "\n\0\n", "x" * 10**6)  # fmt: skip
    calls = {"run": ("run", "out/scene.toml", *RUN[2:]), "resume": RESUME}
    calls["overwrite"] = (*calls["run"], "--overwrite")
    found = [(n, i, c) for n in places for i in range(len(lists)) for c in calls]
    for name, number, call in random.sample(found, len(found)):
        intact = "resume" if call == "resume" else None
        yield Case(
            "links", f"{call} {name} list {number}", prepare(name, lists[number]),
            _untouched(command(*calls[call]), "elsewhere"), intact=intact,
        )  # fmt: skip


#: What a shell does before it becomes the program, or behind it.
LIMITS = (*(f"ulimit -v {most}" for most in (50_000, 200_000, 400_000, 500_000, 600_000, 780_000)),
          "ulimit -n 64", "ulimit -c 0", "umask 777", "exec <&-", "exec >&-", "exec 2>&-",
          "exec <&- >&- 2>&-", "cd /nowhere", "export HOME=/nowhere", "unset HOME",
          "export TMPDIR=/nowhere")  # fmt: skip


def limits(world: World, random: Random) -> Iterator[Case]:
    """Limits of a shell, closed streams, places that are not there."""
    ours = ("OMPI_", "PMIX_", "ORTE_", "PRTE_")

    def begun(before: str, arguments: tuple[str, ...]) -> Callable[[], None]:
        def call() -> None:
            environment = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
            line = f'{before}; exec "$@"'
            program = ["sh", "-c", line, "sh", sys.executable, "-m", "fenics_ehd.cli", *arguments]
            os.execvpe("sh", program, environment)

        return call

    needed = CALLS["run"][0]
    calls = (("bearing", "--eccentricity", "0.5", "--cells", "20x4"), RUN, ("init",))
    found = [(before, call) for before in LIMITS for call in calls]
    for before, call in random.sample(found, len(found)):

        def prepare(folder: Path) -> None:
            world.copy(needed, folder)

        yield Case("limits", f"{before}: {call[0]}", prepare, begun(before, call))
