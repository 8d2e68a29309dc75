"""What became of a call: refused in one line, harmless, right, or a fault."""

import hashlib
import json
import math
import re
import signal
from dataclasses import dataclass
from pathlib import Path

from attempt import Outcome

#: Lines allowed besides the one line of a refusal: progress, and how to continue the run.
PASSING = re.compile(r"progress: |reducing [\w, ]+( \(|$)|resume it with|fenics-ehd: warning|\s*$")

#: Entries that depend on the machine or on bytes of the input, not on the result.
OF_THE_MACHINE = re.compile(
    r"(wall|processor|reduction)_time_s|versions|inputs|file|seconds|host|folder"
)

GOOD = ("refused", "harmless", "right")


@dataclass(frozen=True)
class Verdict:
    """One word, and what to look at when it is a fault."""

    word: str
    detail: str = ""

    @property
    def good(self) -> bool:
        """Whether the program did what it should."""
        return self.word in GOOD


def complaints(text: str) -> tuple[list[str], list[str]]:
    """Lines with which the program refuses, and lines that should not be there."""
    lines = [line.strip() for line in re.split(r"[\r\n]", text)]
    if lines[0].startswith("Usage:"):
        lines = [line for line in lines if line.startswith("Error: ")]
    ours = [
        line
        for line in lines
        if line.startswith(("fenics-ehd: ", "Error: ")) and not PASSING.match(line)
    ]
    return ours, [line for line in lines if line not in ours and not PASSING.match(line)]


def figures(folder: Path, outcome: Outcome) -> dict[str, object]:
    """What a call answered, without times and versions."""
    found: dict[str, object] = {}
    for path in (folder / "out" / "summary.json", folder / "figures.json"):
        if path.is_file():
            found |= json.loads(path.read_text())
    if outcome.stdout.startswith("{"):
        found |= json.loads(outcome.stdout)
    history = folder / "out" / "history.csv"
    if history.is_file():
        found["history"] = hashlib.sha256(history.read_bytes()).hexdigest()
    return {key: value for key, value in found.items() if not OF_THE_MACHINE.search(key)}


def judge(
    outcome: Outcome, folder: Path, intact: dict[str, object] | None, *, slow: bool = False
) -> Verdict:
    """Judge a call.

    Parameters
    ----------
    outcome, folder
        How it ended, and where.
    intact
        The answer to the input that was not malformed, to which no other is right; None: any
        answer of finite numbers is harmless.
    slow
        Whether a call that does not end in time may just have much to do.
    """
    if outcome.status == -signal.SIGALRM:
        word = "harmless" if slow else "hangs"
        return Verdict(word, f"no answer in {outcome.seconds:.0f} s")
    if outcome.status < 0:
        return Verdict("crashes", f"{signal.Signals(-outcome.status).name} {outcome.stderr[-200:]}")
    ours, noise = complaints(outcome.stderr)
    if any("Traceback" in line for line in noise):
        return Verdict("traceback", noise[-1])
    if outcome.status:
        if outcome.status not in (1, 2):
            return Verdict("strange status", f"{outcome.status} {outcome.stderr[-200:]}")
        if len(ours) != 1 or noise:
            return Verdict("not one line", " | ".join((ours + noise)[:3]))
        return Verdict("refused", ours[0])
    found = figures(folder, outcome)
    if intact is None:
        wrong = [k for k, v in found.items() if isinstance(v, float) and not math.isfinite(v)]
        return Verdict("not finite", ", ".join(wrong)) if wrong else Verdict("harmless")
    if found == intact:
        return Verdict("right")
    changed = sorted(k for k in {*found, *intact} if found.get(k) != intact.get(k))
    return Verdict("believed", f"answers with another {', '.join(changed[:4])}")
