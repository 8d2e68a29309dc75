"""Run the tests marked `kernels` with every OpenBLAS kernel that this processor can run.

    python tests/kernels.py [arguments of pytest]

A kernel is skipped if the processor cannot run it, if OpenBLAS was built without it, or if it
rounds like one that is tried anyway: the one that OpenBLAS chooses by itself, which all other runs
of the tests have, or a former one of the list. Kernels of one family share their routines: Zen has
those of Haswell. The reason is printed.
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

#: Prints a digest of products, factorisations and eigenvalues of matrices of several sizes, which
#: differs if any of them is rounded in another way.
ROUNDING = """
import hashlib, numpy, scipy.linalg
digest, random = hashlib.sha256(), numpy.random.default_rng(0)
for size in (3, 17, 64, 129, 300, 700):
    matrix = random.standard_normal((size, size))
    wide = random.standard_normal((size, size + 5))
    vector = random.standard_normal(size)
    gram = matrix @ matrix.T
    for result in (
        gram, matrix @ wide, matrix @ vector, vector @ vector, numpy.linalg.norm(vector),
        scipy.linalg.lu_factor(matrix)[0], scipy.linalg.qr(matrix)[0],
        scipy.linalg.cholesky(gram + size * numpy.eye(size)),
        scipy.linalg.eigh(gram)[0], scipy.linalg.svd(matrix)[1],
        scipy.linalg.solve_triangular(matrix, wide),
    ):
        digest.update(numpy.ascontiguousarray(result).tobytes())
print(digest.hexdigest())
"""


def flags() -> set[str]:
    """What this processor has."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return set(next((line for line in lines if line.startswith("flags")), "").split())


def printed(code: str, environment: dict[str, str]) -> str:
    """What code prints in a Python of its own."""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def with_kernel(kernel: str) -> dict[str, str]:
    """The environment in which OpenBLAS takes a kernel."""
    return {**os.environ, "OPENBLAS_CORETYPE": kernel}


def rounding(environment: dict[str, str]) -> str:
    """Digest of results in an environment, on one thread, as sums depend on the number of them."""
    return printed(ROUNDING, {**environment, "OPENBLAS_NUM_THREADS": "1"})


def obstacle(kernel: str) -> str:
    """Why OpenBLAS cannot take a kernel here, or nothing."""
    missing = NEEDED[kernel] - flags()
    if missing:
        return f"the processor lacks {', '.join(sorted(missing))}"
    found = printed(IN_USE, with_kernel(kernel))
    return "" if found == kernel else f"numpy's library takes {found} instead"


def marked() -> list[str]:
    """Files with such tests: to read all the others takes longer than many of these tests."""
    files = sorted(Path(__file__).parent.glob("test_*.py"))
    return [str(file) for file in files if "mark.kernels" in file.read_text()]


def main(arguments: list[str]) -> int:
    """Test one kernel after the other; how many failed."""
    failures = 0
    command = [sys.executable, "-m", "pytest", "-m", "kernels and not slow", *marked(), *arguments]
    chosen = dict(os.environ)
    tried = {rounding(chosen): f"{printed(IN_USE, chosen)}, which all other tests have"}
    for kernel in NEEDED:
        reason = obstacle(kernel)
        if not reason:
            digest = rounding(with_kernel(kernel))
            reason = f"it rounds like {tried[digest]}" if digest in tried else ""
            tried.setdefault(digest, kernel)
        print(f"--- {kernel}{f': skipped, {reason}' if reason else ''}", flush=True)
        if not reason:
            done = subprocess.run(command, env=with_kernel(kernel), check=False)
            failures += done.returncode != 0
    if len(tried) == 1:
        print("no kernel could be tried that rounds in another way", file=sys.stderr)
        return 1
    return failures


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
