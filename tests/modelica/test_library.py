"""Components of the Modelica Standard Library, read from the folder that MODELICAPATH names, against scipy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gtmodel as gt
from gtmodel.modelica.reference import libraries

pytest.importorskip("lark")
FOLDERS = libraries()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FOLDERS, reason="MODELICAPATH names no folder with the Modelica Standard Library"),
]
EXAMPLES = Path(__file__).parents[2] / "problems" / "models" / "library_examples.mo"
AGREE = 1e-6  # of the largest value: an integrator at 1e-9 beside one at 1e-11


def low_pass(t: float, y: np.ndarray) -> list[float]:
    return [(10 - y[0]) / (100 * 1e-3)]


def drive(t: float, y: np.ndarray) -> list[float]:
    torque = 100 * (y[0] - y[2]) + (y[1] - y[3])
    return [y[1], 10 - torque, y[3], torque / 2]


def oscillator(t: float, y: np.ndarray) -> list[float]:
    return [y[1], (-50 * y[0] - 2 * y[1]) / 2]


def control_loop(t: float, y: np.ndarray) -> list[float]:
    error = 1 - y[1]
    return [error / 0.5, y[2], (2 * (y[0] + error) - y[2] - y[1]) / 0.1]


@pytest.mark.parametrize(
    ("name", "rates", "start", "end", "names"),
    [
        ("LowPass", low_pass, [0.0], 0.5, ["capacitor.v"]),
        ("Drive", drive, [0.0] * 4, 1.0, ["rotor.phi", "rotor.w", "load.phi", "load.w"]),
        ("Oscillator", oscillator, [0.1, 0.0], 1.0, ["mass.s", "mass.v"]),
        ("ControlLoop", control_loop, [0.0] * 3, 3.0, ["controller.x", "plant.y"]),
    ],
)
def test_a_model_of_library_components_agrees_with_its_equations(
    name: str, rates: Callable[[float, np.ndarray], list[float]], start: list[float], end: float, names: list[str]
) -> None:
    run = gt.modelica.load(f"{EXAMPLES}:{name}", library=FOLDERS)().simulate(end)
    theirs = solve_ivp(rates, (0.0, end), start, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    for variable, value in zip(names, theirs, strict=False):
        ours = run.trajectory[variable]
        assert abs(ours[-1] - value) <= AGREE * np.max(np.abs(ours))
