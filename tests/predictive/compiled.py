"""The interior point method of a `StageQP` in C, called from Python: fast, and with multipliers."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gtmodel._files import codegen_dir
from gtmodel.cgen.body import body
from gtmodel.cgen.real import DOUBLE, STAGE_QP, Real, file_name, single
from gtmodel.predictive import StageQP
from gtmodel.predictive.qp_text import QPText
from gtmodel.results.status import Status

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
SHARED = ("gt_float.h", "gt_guard.h", "gt_status.h", *STAGE_QP)

_SOLVE = """\
#include "gt_qp_body.h"
#include "gt_stage_qp.h"

%(table)s
int gt_qp_solve(const double *at, double *inputs, const double *data, const double *last, const double *start,
                double *states, double *kept, double *found)
{
    gt_stage_qp_work work;
    gt_stage_qp_call call;
    gt_stage_qp_outcome out = {0, 0.0, 0.0, 0.0, 0.0};
    int status;
%(arrays)s
%(pointers)s
    call.f = &qp_qp;
    call.data = data;
    call.last_data = last;
    call.w = &work;
    gt_stage_qp_copy(x, at, %(n)d);
    gt_stage_qp_copy(u, inputs, %(nu)d);
    status = gt_stage_qp_solve(&call, start, &out);
    gt_stage_qp_copy(inputs, u, %(nu)d);
    gt_stage_qp_copy(states, x, %(nx)d);
    gt_stage_qp_copy(kept, sides, %(sides)d);
    found[0] = out.cost;
    found[1] = out.gap;
    found[2] = out.residual;
    found[3] = out.gradient;
    found[4] = out.iterations;
    return status;
}
"""


@dataclass(frozen=True)
class Found:
    """What C left: status, states (stages + 1, n), inputs (stages, m), sides, and numbers of the outcome."""

    status: Status
    x: np.ndarray
    u: np.ndarray
    sides: np.ndarray
    cost: float
    gap: float
    residual: float
    gradient: float
    iterations: int


def write(qp: StageQP, folder: Path, real: Real = DOUBLE) -> Path:
    """Write the C files of the problem; the one to compile."""
    folder.mkdir(parents=True, exist_ok=True)
    of = QPText(qp, "qp", real)
    source, declarations = body("qp", [], of.kernels())
    arrays, pointers = of.memory()
    n, m, count = qp.stage.states, qp.stage.inputs, qp.count
    sizes = {"n": n, "nu": count * m, "nx": (count + 1) * n, "sides": of.sides}
    call = _SOLVE % {"table": of.table(), "arrays": arrays, "pointers": pointers, **sizes}
    texts = {"gt_qp_body.h": declarations, "gt_qp.c": source + call}
    texts |= {name: (codegen_dir() / "runtime" / name).read_text() for name in SHARED}
    for name, text in texts.items():
        shared = name in ("gt_float.h", "gt_status.h")
        target = name if real is DOUBLE or shared else file_name(name)
        (folder / target).write_text(text if real is DOUBLE or shared else single(text))
    return folder / "gt_qp.c"


class CompiledQP:
    """A problem in C, compiled into `folder`."""

    def __init__(
        self, qp: StageQP, folder: Path, real: Real = DOUBLE, compiler: str = "gcc", flags: Sequence[str] = FLAGS
    ) -> None:
        source, library = write(qp, folder, real), folder / "qp.so"
        subprocess.run(
            [compiler, *flags, "-shared", "-fPIC", f"-I{folder}", str(source), "-o", str(library), "-lm"], check=True
        )
        self.qp, self.real = qp, real
        self._solve = ctypes.CDLL(str(library)).gt_qp_solve

    @staticmethod
    def missing() -> str | None:
        """One sentence, or None if there is a compiler."""
        return None if shutil.which("gcc") else "there is no gcc on this machine: install the package gcc"

    def solve(self, x: Any, data: Any, last: Any, start: np.ndarray | None = None) -> Found:
        """Solve from inputs of zero."""
        qp, real = self.qp, self.real.dtype
        n, m, count = qp.stage.states, qp.stage.inputs, qp.count
        u, states, numbers = np.zeros((count, m), real), np.zeros((count + 1, n), real), np.zeros(5, real)
        sides = np.zeros(max(1, count * qp.stage.positives + qp.last.positives), real)
        with np.errstate(over="ignore"):
            given = [np.ascontiguousarray(np.append(np.ravel(v), 0.0), real) for v in (x, data, last)]
        pointer = lambda a: None if a is None else ctypes.c_void_p(a.ctypes.data)  # noqa: E731
        status = self._solve(
            pointer(given[0]), pointer(u), pointer(given[1]), pointer(given[2]), pointer(start), pointer(states),
            pointer(sides), pointer(numbers),
        )  # fmt: skip
        cost, gap, residual, gradient, iterations = numbers.tolist()
        return Found(Status(status), states, u, sides, cost, gap, residual, gradient, int(iterations))
