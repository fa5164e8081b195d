"""A learned input, replayed by the C loop and by its twin in Python: equal bit for bit, and the carts err less."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

from gtmodel.control import learning
from gtmodel.loop import ReferenceTable
from gtmodel.loop.process import rows_of
from gtmodel.results import Trajectory
from tests.loop.bench import Bench

RUNS = 6
RAMP = 20


class Learned(Bench):
    """The bench with a table of corrections that `next_input` wrote, iteration after iteration."""

    @cached_property
    def corrections(self) -> ReferenceTable:
        wanted = self.reference.rows[:, :3]
        t, u = 0.004 * np.arange(len(wanted)), np.zeros_like(wanted)
        robot = learning.LearningRobot(loop="printed")
        maps = [robot.plant(k).maps(len(wanted))["motor"] for k in range(3)]
        for _ in range(RUNS):
            moved = wanted - wanted[0] + u
            q = wanted[0] + np.column_stack([T(moved[:, k]) for k, T in enumerate(maps)])
            run = Trajectory(
                t, {"reference": wanted, "input": u, "motor": q}, {"reference": "m", "input": "m", "motor": "m"},
                synthetic="the printed actuators (6.11)",
            )  # fmt: skip
            made = learning.next_input(robot, run, ramp=RAMP)
            text = made.files["next_input.csv"]
            lines = [line for line in str(text).splitlines() if not line.startswith("#")]
            u = np.array([[float(x) for x in line.split(",")[1:]] for line in lines[1:]])
            assert made.trajectory is not None and np.array_equal(u, made.trajectory["next_input"])  # all digits
        return ReferenceTable(u)


@pytest.mark.parametrize("protocol", ["egm", "rsi"])
def test_the_learned_input_in_c_equals_python(bench: Bench, protocol: str, tmp_path: Path) -> None:
    learned = Learned(bench.program, tmp_path, bench.functions)
    pair = learned.both(protocol, "replay", 400, waits=5)
    assert pair.c_log == pair.python_log
    assert np.array_equal(pair.c_run.measured_m, pair.python_run.measured_m)
    commanded = rows_of(pair.c_log)[:, 21:24]
    assert np.ptp(commanded, axis=0).max() > 1e-3
    # and learning helps: the carts err less than without
    before = _without(bench, tmp_path).both(protocol, "replay", 400, waits=5)
    wanted = bench.reference.rows[:400, :3]

    def error(measured: np.ndarray) -> float:
        return float(np.sqrt(np.mean((measured[RAMP:380] - wanted[RAMP:380]) ** 2)))

    assert error(pair.c_run.measured_m) < 0.5 * error(before.c_run.measured_m)


def _without(bench: Bench, place: Path) -> Bench:
    made = Bench(bench.program, place, bench.functions)
    made.__dict__["corrections"] = ReferenceTable(np.zeros((400, 3)))
    return made
