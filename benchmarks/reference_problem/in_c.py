"""The hand-written C program `variational.c`, compiled at run time and called by ctypes."""

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
from pathlib import Path

import numpy as np

from benchmarks.reference_problem import gauss_newton
from benchmarks.reference_problem.equations import COUNT, GRAVITY
from benchmarks.reference_problem.gauss_newton import Fitted, Pass
from benchmarks.reference_problem.problem import ReferenceProblem

SOURCE = Path(__file__).with_name("variational.c")
# The parts of -ffast-math that this program gains from. The option itself would link code that
# flushes subnormal numbers to zero in the whole process, Python's own arithmetic included.
FAST_MATH = (
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-signed-zeros",
    "-fassociative-math",
    "-freciprocal-math",
    "-ffinite-math-only",
)
FLAGS = ("-O3", "-march=native", *FAST_MATH, "-fPIC", "-shared", "-w")
WIDTH, OUTPUTS = 32, 10  # as in the C source
ALIGNMENT = 64  # bytes


def compiler() -> str | None:
    """Return the path of the C compiler (`cc`, or the variable CC), None if there is none."""
    return shutil.which(os.environ.get("CC", "cc"))


def build(folder: Path) -> Path:
    """Return the shared library in a folder, compiled unless it is there."""
    text = SOURCE.read_bytes() + repr((FLAGS, platform.machine())).encode()
    library = folder / f"variational_{hashlib.sha256(text).hexdigest()[:12]}.so"
    if not library.exists():
        folder.mkdir(parents=True, exist_ok=True)
        made = library.with_suffix(f".{os.getpid()}")
        command = [compiler() or "cc", *FLAGS, str(SOURCE), "-o", str(made), "-lm"]
        subprocess.run(command, check=True, capture_output=True, text=True)
        made.replace(library)  # two processes may compile at once
    return library


class VariationalC:
    """Passes of the C program for one problem; its arrays are allocated once.

    Args:
        given: the problem.
        folder: where the compiled library is kept.
    """

    def __init__(self, given: ReferenceProblem, folder: Path):
        self._function = ctypes.CDLL(str(build(folder))).evaluate
        self._function.restype = ctypes.c_double
        self.given, count = given, given.t.size
        self.theta = aligned(WIDTH)
        self.y, self.S = aligned(count, OUTPUTS), aligned(count, OUTPUTS, WIDTH)
        self.noise, self.matrix, self.gradient = (
            aligned(OUTPUTS),
            aligned(WIDTH, WIDTH),
            aligned(WIDTH),
        )
        constants = np.array([*given.constants, GRAVITY])
        before = [np.ascontiguousarray(array, float) for array in (given.t, given.u, given.z)]
        x0 = np.array(given.x0)
        after = [constants, x0, self.y, self.S, self.noise, self.matrix, self.gradient]
        self._kept = (before, after)  # the addresses below must stay valid
        self._arguments = (
            *map(_address, (self.theta, *before)),
            ctypes.c_int(count),
            *map(_address, after),
        )

    def evaluate(self, theta: np.ndarray) -> Pass:
        """Return cost, normal matrix and gradient; `y` and `S` stay in the attributes."""
        self.theta[:COUNT] = theta
        cost = self._function(*self._arguments)
        return Pass(cost, self.matrix[:COUNT, :COUNT].copy(), self.gradient[:COUNT].copy())

    def sensitivities(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return outputs (time, 10) and sensitivities (time, 10, 30)."""
        self.evaluate(theta)
        return self.y.copy(), self.S[..., :COUNT].copy()

    def fit(self) -> Fitted:
        """Return the fit from the problem's start."""
        return gauss_newton.fit(self.evaluate, self.given.start)


def aligned(*shape: int) -> np.ndarray:
    """Return zeros whose first entry lies at a multiple of 64 bytes."""
    size = int(np.prod(shape)) * 8
    raw = np.zeros(size + ALIGNMENT, np.uint8)
    begin = -raw.ctypes.data % ALIGNMENT
    return raw[begin : begin + size].view(float).reshape(shape)


def _address(array: np.ndarray) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)
