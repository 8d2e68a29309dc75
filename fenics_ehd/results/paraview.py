"""A ParaView series of a run: one file that opens all bodies and films over the time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from fenics_ehd.base.folder import claim
from fenics_ehd.multibody.mechanism import Mechanism
from fenics_ehd.multibody.result import Result
from fenics_ehd.results.blocks import DISPLACEMENT, PRESSURE, Block, mechanism_blocks
from fenics_ehd.results.motion import RecordedMotion, nearest_steps
from fenics_ehd.results.part_fields import PartFields
from fenics_ehd.results.replay import Replay

#: What ParaView opens, in the folder of a series.
SERIES = "run.pvd"


def write_run(
    mechanism: Mechanism,
    result: Result,
    parts: Mapping[str, PartFields],
    directory: Path,
    frames: int,
) -> Path:
    """Write recorded steps of a run, evenly spread, as a series.

    Parameters
    ----------
    mechanism, result
        Of the run, with its films.
    parts
        Whole parts of flexible bodies by name; those of others are drawn as lines.
    directory
        Where the files go.
    frames
        At most how many steps.

    Returns
    -------
    Path
        See `write_series`.
    """
    chosen = nearest_steps(np.asarray(result.time), frames)
    shown = result.each(lambda values: values[chosen])
    replay = Replay(mechanism, RecordedMotion.of(shown))
    films = {name: joint.film for name, joint in shown.joints.items()}
    return write_series(directory, shown.time, mechanism_blocks(replay, films, parts))


def write_series(directory: str | Path, times: np.ndarray, blocks: Sequence[Block]) -> Path:
    """Write ``run.pvd``, which opens one multi-block ``.vtm`` file for each time.

    Parameters
    ----------
    directory
        Where the files go.
    times
        shape (t,) [s].
    blocks
        What is drawn.

    Returns
    -------
    Path
        ``run.pvd``, times in seconds. Points move with the bodies; ``displacement_m`` is the
        elastic motion, to be warped by; ``pressure_Pa`` that of the films, on their own nodes and
        on the bores of whole parts, where it is zero elsewhere; ``gap_m`` is the films'.
    """
    directory = Path(directory)
    frames = [(f"run_{i:04d}.vtm", float(time)) for i, time in enumerate(times)]
    files = [
        [f"{block.group}-{block.name}_{i:04d}.vtu" for block in blocks] for i in range(len(times))
    ]
    claim(directory, [SERIES, *(frame for frame, _ in frames), *chain(*files)])
    for i, (frame, _) in enumerate(frames):
        found: dict[str, list[tuple[str, str]]] = {}
        for block, file in zip(blocks, files[i], strict=True):
            _write_block(directory / file, block, i)
            found.setdefault(block.group, []).append((block.name, file))
        (directory / frame).write_text(_multi_block(found))
    series = directory / SERIES
    lines = [
        f'    <DataSet timestep="{time:.9e}" part="0" file={quoteattr(file)}/>'
        for file, time in frames
    ]
    series.write_text(_xml("Collection", ["  <Collection>", *lines, "  </Collection>"]))
    return series


def _write_block(path: Path, block: Block, instant: int) -> None:
    points, displacement, fields = block.at(instant)
    data = {DISPLACEMENT: displacement, **{name: np.asarray(v) for name, v in fields.items()}}
    meshio.Mesh(points, [(block.kind, block.cells)], point_data=data).write(path)
    # The fields that ParaView shows at first, which meshio does not name.
    scalars = f' Scalars="{PRESSURE}"' if PRESSURE in fields else ""
    named = f'<PointData{scalars} Vectors="{DISPLACEMENT}">'.encode()
    path.write_bytes(path.read_bytes().replace(b"<PointData>", named, 1))


def _multi_block(groups: Mapping[str, Sequence[tuple[str, str]]]) -> str:
    """Files by the name of their block, in groups."""
    lines = ["  <vtkMultiBlockDataSet>"]
    for number, (group, members) in enumerate(groups.items()):
        lines.append(f'    <Block index="{number}" name={quoteattr(group)}>')
        lines += [
            f'      <DataSet index="{i}" name={quoteattr(name)} file={quoteattr(file)}/>'
            for i, (name, file) in enumerate(members)
        ]
        lines.append("    </Block>")
    return _xml("vtkMultiBlockDataSet", [*lines, "  </vtkMultiBlockDataSet>"])


def _xml(kind: str, lines: Sequence[str]) -> str:
    head = f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian">'
    return "\n".join(['<?xml version="1.0"?>', head, *lines, "</VTKFile>", ""])
