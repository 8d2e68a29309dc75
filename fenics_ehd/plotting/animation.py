"""Frames of a figure whose drawings move, as GIF or MP4."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.figure import Figure
from PIL import Image

from fenics_ehd.base.errors import InputError, SettingsError
from fenics_ehd.base.output import require_writable
from fenics_ehd.base.whole_file import written_aside
from fenics_ehd.plotting.picture import plt

#: Pixels per inch of the file formats: a GIF has no compression in time.
RESOLUTION = {".gif": 90, ".mp4": 120}

#: Colours of a GIF, the same in all its frames; frames they are taken from, and every which pixel.
COLOURS, SAMPLES, SPARSE = 256, 6, 3

#: Parts of red, green and blue, of 255, above which a colour is white.
NEARLY_WHITE = 248

#: Fixed date and encoder signature: the same run gives the same file.
_REPEATABLE = ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-threads", "1"]

Show = Callable[[int], None]


def require_animation_format(path: str | Path) -> None:
    """Refuse an animation that cannot be written, before any work is done for it.

    Raises
    ------
    SettingsError
        The file's ending is neither .gif nor .mp4.
    InputError
        No permission, or no ffmpeg for MP4.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in RESOLUTION:
        raise SettingsError(f"-o {path}: its ending must be one of {', '.join(RESOLUTION)}")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(f"-o {path}: MP4 needs ffmpeg, Debian's package ffmpeg; or choose .gif")
    require_writable(path)


def save_animation(
    figure: Figure,
    show: Show,
    count: int,
    path: str | Path,
    rate: int,
    progress: Callable[[], None],
) -> Path:
    """Write an animation, whole or not at all.

    Parameters
    ----------
    figure, show
        The figure, closed in the end, and what draws one of its frames.
    count
        Number of frames.
    path
        GIF or MP4, by its ending.
    rate
        Frames a second.
    progress
        Called after every frame.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    SettingsError, InputError
        As in `require_animation_format`.
    """
    require_animation_format(path)
    path = Path(path)
    suffix = path.suffix.lower()
    figure.set_dpi(RESOLUTION[suffix])
    path.parent.mkdir(parents=True, exist_ok=True)
    write = _write_gif if suffix == ".gif" else _write_mp4
    try:
        with written_aside(path) as aside:
            write(figure, show, count, aside, rate, progress)
    finally:
        plt.close(figure)
    return path


def _write_gif(
    figure: Figure, show: Show, count: int, path: Path, rate: int, progress: Callable[[], None]
) -> None:
    """One palette for all frames, or colours would flicker."""
    chosen = np.linspace(0, count - 1, min(count, SAMPLES)).astype(int)
    samples = [_picture(figure, show, i)[::SPARSE, ::SPARSE] for i in chosen]
    palette = _with_white(Image.fromarray(np.vstack(samples)).quantize(COLOURS))

    def frames() -> Iterator[Image.Image]:
        for i in range(count):
            picture = Image.fromarray(_picture(figure, show, i))
            yield picture.quantize(palette=palette, dither=Image.Dither.NONE)
            progress()

    first, *others = frames()
    delays = _delays(count, rate)
    first.save(path, save_all=True, append_images=others, duration=delays, loop=0)


def _delays(count: int, rate: int) -> list[int]:
    """Milliseconds that each frame stands: a GIF counts in hundredths of a second."""
    ends = np.round(100 / rate * np.arange(count + 1)).astype(int)
    return (10 * np.diff(ends)).tolist()


def _with_white(palette: Image.Image) -> Image.Image:
    """The palette with its lightest colours, means of near ones, made the paper's white."""
    colours = np.array(palette.getpalette()).reshape(-1, 3)
    colours[colours.min(axis=1) >= NEARLY_WHITE] = 255
    palette.putpalette(colours.ravel().tolist())
    return palette


def _picture(figure: Figure, show: Show, frame: int) -> np.ndarray:
    """Pixels of one frame, shape (height, width, 3)."""
    show(frame)
    figure.canvas.draw()
    return np.array(figure.canvas.buffer_rgba())[..., :3]


def _write_mp4(
    figure: Figure, show: Show, count: int, path: Path, rate: int, progress: Callable[[], None]
) -> None:
    options = ["-pix_fmt", "yuv420p", "-crf", "20", *_REPEATABLE]
    writer = FFMpegWriter(fps=rate, codec="libx264", extra_args=options)
    with writer.saving(figure, path, dpi=figure.dpi):
        for i in range(count):
            show(i)
            writer.grab_frame()
            progress()
