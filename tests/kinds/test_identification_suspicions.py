"""Logs that are wrong in a way no reader can see: each ends in a failed check or a sentence, none looks right."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.kinds import Context, InputError, identification
from gtmodel.kinds.load import validate
from tests.identify.plants import NOISE, plant, simulator, truth

TABLE: dict[str, Any] = {
    "kind": "identification",
    "robot": "l1_tape",
    "variant": "links",
    "log": {"files": ["log.csv"], "position": {"column": "q", "unit": "m"}, "effort": {"column": "tau", "unit": "N"}},
}


def solve(folder: Path, q: np.ndarray | None = None, tau: np.ndarray | None = None, seconds: float = 1.0):
    """A log of the plant, seed 3, with one thing changed; times `seconds` where the clock's unit is wrong."""
    t = simulator(16.0).truth
    clean = t["tau"] + NOISE * np.random.default_rng(3).normal(size=t["tau"].shape)
    signals = {"q": np.round(t["q"], 6) if q is None else q, "tau": clean if tau is None else tau(clean)}  # type: ignore[operator]
    gt.Trajectory(seconds * t.time, signals, {"q": "m", "tau": "N"}, synthetic="seed 3").to_csv(folder / "log.csv")
    return identification.solve(validate(identification.Schema, TABLE), Context(folder=folder))


def failed(outcome: Any) -> set[str]:
    return {name for name, check in outcome.checks.items() if not check.passed}


def test_a_sound_log_raises_no_suspicion(tmp_path: Path):
    outcome = solve(tmp_path)
    assert failed(outcome) == set()
    assert {"unexplained_share", "work_of_friction_J", "energy_balance"} <= set(outcome.checks)
    # friction takes some hundred newtons over some metres a second
    assert outcome.checks["work_of_friction_J"].value > 100.0
    assert not any("check" in s or "saturates" in s for s in outcome.values["sentences"])


@pytest.mark.parametrize(
    ("tau", "fails", "said"),
    [
        (lambda x: x * [1, -1, 1], {"unexplained_share", "work_of_friction_J"}, r"tau\[1\]: friction would drive"),
        (lambda x: x[:, [1, 0, 2]], {"unexplained_share"}, r"tau\[0\]: .* left unexplained; check sign, order"),
        (
            lambda x: x[:, [1, 0, 2]],
            {"exchanged_columns"},
            r"tau\[0\] and tau\[1\] look exchanged: .* as tau\[1\], tau\[0\]",
        ),
        (lambda x: x[:, [0, 2, 1]], {"exchanged_columns"}, r"tau\[1\] and tau\[2\] look exchanged"),
        (lambda x: 1e-3 * x, {"parameters_far_off"}, "m_p is 0.00102 times its nominal value; check the units"),
        (
            lambda x: np.roll(x, 1, axis=0),
            {"delay_moves_a_parameter"},
            r"the efforts look .* ms later than the positions",
        ),
        (
            lambda x: np.clip(x, -500, 500),
            {"saturated_share"},
            r"tau\[2\] of .* stands at its largest value, 500 N, in 17 % of the",
        ),
    ],
)
def test_wrong_efforts(tmp_path: Path, tau: Any, fails: set[str], said: str):
    outcome = solve(tmp_path, tau=tau)
    assert fails <= failed(outcome)
    assert any(re.search(said, s) for s in outcome.values["sentences"]), outcome.values["sentences"]


@pytest.mark.parametrize(
    ("tau", "said"),
    [
        (lambda x: -x, r"log: every parameter would be negative \(m_p = .*check the signs"),
        (lambda x: 0 * x, r"log: tau\[0\], tau\[1\], tau\[2\] is zero all the time"),
    ],
)
def test_refused_efforts(tmp_path: Path, tau: Any, said: str):
    with pytest.raises(InputError, match=said):
        solve(tmp_path, tau=tau)


def test_a_clock_in_milliseconds(tmp_path: Path):
    outcome = solve(tmp_path, seconds=1e3)
    assert any("times its nominal value; check the units of time" in s for s in outcome.values["sentences"])


def test_standing_still_with_a_noisy_sensor(tmp_path: Path):
    still = np.asarray(simulator(16.0).truth["q"][:1]) + 1e-6 * np.random.default_rng(4).normal(size=(4000, 3))
    with pytest.raises(InputError, match="nothing moves beyond the noise of the position"):
        solve(tmp_path, q=still)


def test_a_coarse_position(tmp_path: Path):
    coarse = 5e-4 * np.round(simulator(16.0).truth["q"] / 5e-4)
    with pytest.raises(InputError, match=r"never are all of 'q' faster than 0.375 m/s, 3 steps of the position"):
        solve(tmp_path, q=coarse)


def test_a_position_without_steps_but_with_noise(tmp_path: Path):
    # 0.1 mm: the noise must set neither the cut-off nor the sign of a slow velocity
    q = simulator(16.0).truth["q"]
    outcome = solve(tmp_path, q=q + 1e-4 * np.random.default_rng(5).normal(size=q.shape))
    values = outcome.values
    assert values["cutoff_Hz"] < 10.0 and 0.02 < values["dropped_share"] < 0.3
    for name, value in truth().items():
        if name.startswith(("coulomb", "viscous")):
            assert values["parameters"][name] == pytest.approx(value, rel=0.04)
    assert values["parameters"]["m_p"] == pytest.approx(plant().m_p, abs=0.6)


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_a_copy_is_refused_wherever_it_is_said_to_be(tmp_path: Path, shift: float):
    """Positions that a constant moved differ in their digits; the noise of the efforts does not."""
    t = simulator(16.0).truth
    clean = t["tau"] + NOISE * np.random.default_rng(3).normal(size=t["tau"].shape)
    half = len(clean) // 2
    q = t["q"] + 1e-3 * np.random.default_rng(4).normal(size=t["q"].shape)
    q[half : 2 * half] = q[:half] + shift
    with pytest.raises(InputError, match="a copy counts twice"):
        solve(tmp_path, q=q, tau=lambda x: np.concatenate([clean[:half], clean[:half], clean[2 * half :]]))


def test_sixty_sound_logs_raise_no_suspicion_of_their_columns():
    from gtmodel.identify.exchanged import exchanged

    for seed in range(60):
        rng = np.random.default_rng(seed)
        n, m, k = int(rng.integers(20, 400)), int(rng.integers(2, 5)), 5
        Y = rng.normal(size=(n * m, k))
        e = (Y @ rng.normal(size=k) + rng.uniform(1e-6, 3.0) * rng.normal(size=n * m)).reshape(n, m)
        Q = np.linalg.qr(Y)[0]

        def left(order, signs, e=e, Q=Q):
            b = (e[:, order] * signs).reshape(-1)
            return float(b @ b - np.sum((Q.T @ b) ** 2))

        found = exchanged(left, m, n * m - k, 1.0)
        assert found is not None and found.passed
