"""Run the tests marked `kernels` with every OpenBLAS kernel that this processor can run.

    python tests/kernels.py [arguments of pytest]

A kernel that it cannot run, that OpenBLAS was built without, or that it takes by itself, so that
every other run of the tests has it, is skipped, and that is printed.
"""

import os
import subprocess
import sys
from pathlib import Path

#: What a processor must have, as Linux calls it.
NEEDED = {
    "Haswell": {"avx2", "fma"},
    "Zen": {"avx2", "fma"},
    "SkylakeX": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "Prescott": {"pni"},
}

#: Prints the kernel in use; OpenBLAS takes its own choice for one that it was built without.
IN_USE = """
import ctypes, numpy
names = {line.split()[-1] for line in open("/proc/self/maps") if "openblas" in line}
library = ctypes.CDLL(next((name for name in names if "libopenblas" in name), None))
function = getattr(library, "openblas_get_corename", lambda: b"no OpenBLAS")
function.restype = ctypes.c_char_p
print(function().decode())
"""


def flags() -> set[str]:
    """What this processor has."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return set(next((line for line in lines if line.startswith("flags")), "").split())


def in_use(environment: dict[str, str]) -> str:
    """Kernel that numpy's library takes."""
    return subprocess.run(
        [sys.executable, "-c", IN_USE], env=environment, capture_output=True, text=True, check=True
    ).stdout.strip()


def obstacle(kernel: str, environment: dict[str, str]) -> str:
    """Why a kernel is not tried here, or nothing."""
    missing = NEEDED[kernel] - flags()
    if missing:
        return f"the processor lacks {', '.join(sorted(missing))}"
    if in_use(dict(os.environ)) == kernel:
        return "the other tests have it"
    found = in_use(environment)
    return "" if found == kernel else f"numpy's library takes {found} instead"


def marked() -> list[str]:
    """Files with such tests: to read all the others takes longer than many of these tests."""
    files = sorted(Path(__file__).parent.glob("test_*.py"))
    return [str(file) for file in files if "mark.kernels" in file.read_text()]


def main(arguments: list[str]) -> int:
    """Test one kernel after the other; how many failed, 1 if none could be tried."""
    results = []
    command = [sys.executable, "-m", "pytest", "-m", "kernels and not slow", *marked(), *arguments]
    for kernel in NEEDED:
        environment = {**os.environ, "OPENBLAS_CORETYPE": kernel}
        reason = obstacle(kernel, environment)
        print(f"--- {kernel}{f': skipped, {reason}' if reason else ''}", flush=True)
        if not reason:
            results.append(subprocess.run(command, env=environment, check=False).returncode)
    return sum(map(bool, results)) if results else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
