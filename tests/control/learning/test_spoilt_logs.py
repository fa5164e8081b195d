"""A fit is judged before it is used: logs with wrong signs, units, channels, jumps or noise give no plant."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gtmodel.control import learning
from gtmodel.results import ArgumentError

N = 1500
AXES = [learning.flexible_axis(7.4, 0.2).maps(N), learning.flexible_axis(11.5, 0.05).maps(N)]
NOISE = {"motor": 1e-6, "tool": 1e-6, "acceleration": 0.07}


def log(seed: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Two axes under random levels of 1 mm, synthetic."""
    rng = np.random.default_rng(seed)
    r = 1e-3 * np.repeat(rng.normal(size=(N // 10, 2)), 10, axis=0)
    made = {n: np.column_stack([T[n](r[:, k]) for k, T in enumerate(AXES)]) for n in NOISE}
    return r, {n: y + NOISE[n] * rng.normal(size=y.shape) for n, y in made.items()}


R, CLEAN = log(1)
RNG = np.random.default_rng(2)
MOTOR, TOOL, FELT = CLEAN["motor"], CLEAN["tool"], CLEAN["acceleration"]
STEP = MOTOR + np.where(np.arange(N) < 700, 0.0, 5.0)[:, None]


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        ({"acceleration": -FELT}, "reading is -1"),
        ({"acceleration": FELT / 9.81}, "reading is 0.10"),
        ({"acceleration": FELT[:, ::-1]}, "'acceleration' of x follows the reference of y"),
        ({"motor": MOTOR[:, ::-1]}, "'motor' of x follows the reference of y"),
        ({"tool": TOOL[:, ::-1]}, "'tool' of x follows the reference of y"),
        ({"tool": -TOOL}, "to 'tool' is -1;"),
        ({"motor": 1e3 * MOTOR}, r"to 'motor' is 1e\+03;"),
        ({"motor": STEP}, "jumps by 5 m after row 699"),
        ({"motor": 1e-3 * RNG.normal(size=(N, 2))}, "explains 0 % of the variance of 'motor'"),
        ({"tool": 1e-3 * np.cumsum(RNG.normal(size=(N, 2)), axis=0)}, "of the variance of 'tool'"),
        ({"tool": 1e-3 * np.sin(0.2 * np.arange(N))[:, None] * [1.0, 1.0]}, "without free motion"),
    ],
    ids=["sign", "g", "felt exchanged", "motors exchanged", "tools exchanged", "tool's sign", "unit", "step", "noise",
         "walk", "hum"],
)  # fmt: skip
def test_a_spoilt_log_gives_no_robot(spoilt: dict[str, Any], said: str) -> None:
    with pytest.raises(ArgumentError, match=said) as error:
        learning.identified_robot(R, {**CLEAN, **spoilt})
    assert error.value.argument == "signals" and "lags" not in str(error.value)


@pytest.mark.parametrize("order", [None, 4])
def test_unrelated_noise_gives_no_axis_and_no_tool(order: int | None) -> None:
    for seed in range(3):
        z = np.random.default_rng(seed).normal(size=(2, N))
        for make in (lambda z=z: learning.identified_axis(R[:, 0], {"motor": z[0], "tool": z[1]}, order=order, delay=0),
                     lambda z=z: learning.identified_tool(z[0], z[1], order=order)):  # fmt: skip
            with pytest.raises(ArgumentError, match=r"explains|is unstable") as error:  # noise may look unstable
                make()
            assert "is unstable" in str(error.value) or error.value.argument == "signals"


def test_twenty_clean_logs_are_taken() -> None:
    for seed in range(20):
        r, signals = log(100 + seed)
        axis = learning.identified_axis(r[:, 1], {n: y[:, 1] for n, y in signals.items()}, order=3, delay=5)
        mode = learning.ModelledRobot([axis]).mode(0)
        assert mode is not None and mode[0] == pytest.approx(11.5, rel=0.01)


def test_columns_that_do_not_match_are_refused() -> None:
    for reference, signals, argument in (
        (R[:, 0], {"motor": MOTOR}, "reference"),
        (R, {"motor": MOTOR[1:]}, "signals"),
    ):
        with pytest.raises(ArgumentError) as error:
            learning.identified_robot(reference, signals)
        assert error.value.argument == argument
