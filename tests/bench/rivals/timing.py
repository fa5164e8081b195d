"""Result of every method: the optimum, and the processor time of set-up and solve."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from gtmodel.optimize.ipopt import LARGE, OF_LARGE

TOLERANCE = 1e-8
# the same for all of them: MUMPS's order AMD is worth 18 % per iteration, and the rivals have it too
IPOPT: dict[str, Any] = {
    "tol": TOLERANCE, "max_iter": 1000, "mu_strategy": "adaptive", "mumps_pivot_order": 0, "print_level": 0,
    "sb": "yes", "honor_original_bounds": "yes",
}  # fmt: skip
NLPSOL: dict[str, Any] = {"ipopt": IPOPT, "print_time": False, "error_on_fail": False, "show_eval_warnings": False}


def of_size(unknowns: int) -> dict[str, Any]:
    """NLPSOL with the options of MUMPS that gtmodel takes for so many unknowns."""
    return {**NLPSOL, "ipopt": {**IPOPT, **(OF_LARGE if unknowns >= LARGE else {})}}


@dataclass(frozen=True)
class Result:
    """Cost, iterations, and seconds of set-up and solve; a method that did not converge is no method.

    check: seconds of an estimate of the discretisation's error, which no total holds: the rivals make none.
    """

    objective: float
    iterations: int
    setup: float
    solve: float
    converged: bool = True
    compile: float = 0.0
    check: float = 0.0

    @property
    def total(self) -> float:
        return self.setup + self.solve


class Clock:
    """Processor time since it was made, and at each `lap`."""

    def __init__(self) -> None:
        self.last = time.process_time()

    def lap(self) -> float:
        now = time.process_time()
        last, self.last = self.last, now
        return now - last
