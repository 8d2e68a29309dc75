"""Input files in the report of a run: its scene, and the files to which the scene refers.

The report has the content of these files. Saved in one folder under the names in the report, they
repeat the run: the scene in the report refers to files next to it, whereas the scene in the folder
of the run has absolute paths.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fenics_ehd.scenes.scene import FILES, Scene, by_key, scene_of, scene_text

#: Largest file that a page contains [bytes]: a browser opens a larger page slowly. A table of an
#: engine cycle has about 10 kB; files of models and reduced bodies may be larger.
LARGEST = 2_000_000


@dataclass(frozen=True)
class InputFile:
    """A file that is needed to repeat a run.

    Attributes
    ----------
    name
        Name of the file next to the scene.
    digest
        SHA-256 of the content, as hexadecimal digits; empty if the file cannot be read.
    content
        Content of the file; empty if the page does not have it.
    note
        Reason why the page does not have the content, or a warning; empty for neither.
    """

    name: str
    digest: str
    content: bytes = b""
    note: str = ""

    @property
    def text(self) -> str:
        """Content as text; empty if the file is binary, or not in the page."""
        try:
            return self.content.decode("utf-8")
        except UnicodeDecodeError:
            return ""

    @property
    def lines(self) -> int:
        """Number of lines of `text`."""
        return len(self.text.splitlines())


def input_names(scene: Scene) -> dict[str, str]:
    """Names of the files of a scene next to it, by absolute path; no two files share a name."""
    names: dict[str, str] = {}
    for _, value in by_key(scene.tables):
        if isinstance(value, str) and Path(value).suffix in FILES and Path(value).is_absolute():
            names.setdefault(value, _unused(Path(value), names.values()))
    return names


def _unused(path: Path, used: Collection[str]) -> str:
    """Name of a file, with a number if the name is in use: ``gas-2.csv``."""
    name = path.name
    number = 2
    while name in used:
        name = f"{path.stem}-{number}{path.suffix}"
        number += 1
    return name


def scene_with_names(scene: Scene, names: Mapping[str, str]) -> str:
    """TOML text of a scene whose files have new names, by absolute path."""
    return scene_text(scene_of(_renamed(scene.tables, names), scene.name))


def _renamed(tables: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    """Tables in which the texts that `names` has are replaced."""
    changed: dict[str, Any] = {}
    for key, value in tables.items():
        if isinstance(value, Mapping):
            changed[key] = _renamed(value, names)
        else:
            changed[key] = names.get(value, value) if isinstance(value, str) else value
    return changed


def run_inputs(
    text: str, scene: Scene, name: str, digests: Mapping[str, str] | None = None
) -> list[InputFile]:
    """Files that repeat a run, of which the first is the scene.

    Parameters
    ----------
    text, scene
        Scene of the run as stored in its folder, as text and as read from it.
    name
        Name of the scene's file.
    digests
        SHA-256 of the files at the start of the run, by the name of the file without its folder;
        None if they are unknown.
    """
    names = input_names(scene)
    content = (scene_with_names(scene, names) if names else text).encode()
    scene_file = InputFile(name, hashlib.sha256(content).hexdigest(), content)
    return [scene_file, *_referred(names, digests or {})]


def _referred(names: Mapping[str, str], digests: Mapping[str, str]) -> Iterator[InputFile]:
    """Yield the files to which a scene refers, `names` by absolute path."""
    alike = Counter(Path(path).name for path in names)
    for path, name in names.items():
        try:
            content = Path(path).read_bytes()
        except OSError:
            yield InputFile(name, "", note=f"not in this page: {path} cannot be read")
            continue
        digest = hashlib.sha256(content).hexdigest()
        notes = []
        # The digest of several files with one name is that of all of them together.
        if alike[Path(path).name] == 1 and digests.get(Path(path).name, digest) != digest:
            notes.append("changed after the run: this is not the file that the run has read")
        if len(content) > LARGEST:
            notes.append(f"not in this page, because it has {1e-6 * len(content):.1f} MB")
            content = b""
        yield InputFile(name, digest, content, "; ".join(notes))
