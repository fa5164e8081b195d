"""Trials of the solvers on tiny problems with known answers; a program whose arguments are the trials to leave out.

It prints one JSON object per line: {"begin": name} before a trial, {"trial": name, "fault": "", "about": ""} after it.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

IMPORTS = ("numpy", "scipy.linalg", "pydantic", "casadi")
LINEAR_SOLVERS = ("mumps", "spral", "ma27", "ma57", "ma77", "ma86", "ma97")
TOLERANCE = 1e-4  # osqp solves to some 1e-5
Trial = Callable[[], str]


def trials() -> Iterator[tuple[str, Trial]]:
    """Yield names and trials; a trial returns information about a success, and raises otherwise."""
    yield from ((f"import {name}", partial(_import, name)) for name in IMPORTS)
    yield "blas", _blas
    yield from ((f"ipopt {name}", partial(_ipopt, name)) for name in LINEAR_SOLVERS[:1])
    yield "fatrop", _fatrop
    yield from ((name, partial(_quadratic, name)) for name in ("osqp", "qrqp"))
    yield from ((name, partial(_integrated, name)) for name in ("cvodes", "idas"))
    # last, because these may crash if a library is incomplete
    yield from ((f"ipopt {name}", partial(_ipopt, name)) for name in LINEAR_SOLVERS[1:])


def _import(name: str) -> str:
    __import__(name)
    return ""


def _blas() -> str:
    """BLAS of NumPy, with its threads if it is the OpenBLAS of a wheel."""
    import numpy as np

    config: Any = np.show_config(mode="dicts")
    blas = config.get("Build Dependencies", {}).get("blas", {})
    text = f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip()
    for path in sorted((Path(np.__file__).parent.parent / "numpy.libs").glob("*openblas*")):
        library = ctypes.CDLL(str(path))
        for name in ("scipy_openblas_get_num_threads64_", "openblas_get_num_threads64_", "openblas_get_num_threads"):
            if hasattr(library, name):
                count = int(getattr(library, name)())
                return f"{text}, {count} thread{'s' if count > 1 else ''}"
    return text


def _ipopt(linear_solver: str) -> str:
    """min (x - 1)^2 + (y - 2)^2 with x y = 2."""
    import casadi as ca

    x = ca.SX.sym("x", 2)
    problem = {"x": x, "f": (x[0] - 1) ** 2 + (x[1] - 2) ** 2, "g": x[0] * x[1]}
    options = {"print_time": False, "ipopt": {"linear_solver": linear_solver, "print_level": 0, "sb": "yes"}}
    solver = ca.nlpsol("tried", "ipopt", problem, options)
    end = solver(x0=[1.5, 1.5], lbg=2, ubg=2)
    if not solver.stats()["success"]:
        raise RuntimeError(str(solver.stats()["return_status"]))
    return _equal(end["x"], [1.0, 2.0])


def _fatrop() -> str:
    import casadi as ca

    x = ca.SX.sym("x", 2)
    problem = {"x": x, "f": (x[0] - 1) ** 2 + (x[1] - 2) ** 2}
    solver = ca.nlpsol("tried", "fatrop", problem, {"print_time": False, "fatrop": {"print_level": 0}})
    return _equal(solver(x0=[0, 0])["x"], [1.0, 2.0])


def _quadratic(name: str) -> str:
    import casadi as ca

    x = ca.SX.sym("x", 2)
    problem = {"x": x, "f": (x[0] - 1) ** 2 + (x[1] - 2) ** 2, "g": x[0] + x[1]}
    quiet: dict[str, Any] = {"osqp": {"verbose": False}} if name == "osqp" else {"print_iter": False}
    quiet |= {} if name == "osqp" else {"print_header": False}
    return _equal(ca.qpsol("tried", name, problem, {"print_time": False, **quiet})(lbg=1, ubg=2)["x"], [0.5, 1.5])


def _integrated(name: str) -> str:
    """dy/dt = -y over one second; for IDAS as z = dy/dt, 0 = z + y."""
    import casadi as ca

    y, z = ca.SX.sym("y"), ca.SX.sym("z")
    system = {"x": y, "ode": -y} if name == "cvodes" else {"x": y, "z": z, "ode": z, "alg": z + y}
    end = ca.integrator("tried", name, system, 0.0, 1.0, {"reltol": 1e-8, "abstol": 1e-10})
    return _equal(end(x0=1.0, **({} if name == "cvodes" else {"z0": -1.0}))["xf"], [0.36787944117144233])


def _equal(answer: Any, expected: list[float]) -> str:
    values = [float(v) for v in answer.full().ravel()]
    if not all(abs(v - e) < TOLERANCE for v, e in zip(values, expected, strict=True)):
        raise RuntimeError(f"found {values}; expected {expected}")
    return ""


def main(left_out: list[str]) -> None:
    """Run all other trials; the output of the solvers is discarded."""
    shown = os.fdopen(os.dup(1), "w")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)

    def tell(**what: str) -> None:
        print(json.dumps(what), file=shown, flush=True)

    for name, trial in trials():
        if name in left_out:
            continue
        tell(begin=name)
        fault = about = ""
        try:
            with open(os.devnull, "w") as quiet, contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
                about = trial()
        except BaseException as error:  # a trial that ends in any way is a row
            fault = f"{type(error).__name__}: {str(error).strip().splitlines()[-1] if str(error).strip() else ''}"
        tell(trial=name, fault=fault, about=about)


if __name__ == "__main__":
    main(sys.argv[1:])
