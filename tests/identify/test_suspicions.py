"""Logs that are wrong in a way no reader can see: each ends in a failed check or a sentence, none looks right."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify import IdentificationStudy, study
from gtmodel.results import ArgumentError
from tests.identify.plants import NOISE, plant, simulator, truth

LINKS = gt.robots.inertia_variant("links")


def solve(
    q: np.ndarray | None = None, tau: Any = None, seconds: float = 1.0, accept: tuple[str, ...] = ()
) -> IdentificationStudy:
    """A log of the plant, seed 3, with one thing changed; times `seconds` where the clock's unit is wrong."""
    t = simulator(16.0).truth
    clean = t["tau"] + NOISE * np.random.default_rng(3).normal(size=t["tau"].shape)
    signals = {"q": np.round(t["q"], 6) if q is None else q, "tau": clean if tau is None else tau(clean)}
    log = gt.Trajectory(seconds * t.time, signals, {"q": "m", "tau": "N"}, synthetic="seed 3")
    return study(LINKS.robot, log, LINKS.free, fitting=gt.identify.Fitting(accept=list(accept)))


def failed(outcome: IdentificationStudy) -> set[str]:
    return {name for name, check in outcome.checks.items() if not check.passed}


def test_a_sound_log_raises_no_suspicion():
    outcome = solve()
    assert failed(outcome) == set()
    assert {"unexplained_share", "work_of_friction_J", "energy_balance"} <= set(outcome.checks)
    # friction takes some hundred newtons over some metres a second
    assert outcome.checks["work_of_friction_J"].value > 100.0
    assert not any("check" in s or "saturates" in s for s in outcome.notes)


@pytest.mark.parametrize(
    ("tau", "fails", "said"),
    [
        (lambda x: x * [1, -1, 1], {"unexplained_share", "work_of_friction_J"}, r"tau\[1\]: friction would drive"),
        (lambda x: x[:, [1, 0, 2]], {"unexplained_share"}, r"tau\[0\]: .* is unexplained; check sign, order"),
        (
            lambda x: x[:, [1, 0, 2]],
            {"exchanged_columns"},
            r"tau\[0\], tau\[1\] look exchanged: .* as tau\[1\], tau\[0\]",
        ),
        (lambda x: x[:, [0, 2, 1]], {"exchanged_columns"}, r"tau\[1\], tau\[2\] look exchanged"),
        (lambda x: 1e-3 * x, {"parameters_far_off"}, "m_p is 0.00102 times its nominal value; check the units"),
        (
            lambda x: np.roll(x, 1, axis=0),
            {"delay_moves_a_parameter"},
            r"the efforts look .* ms later than the positions",
        ),
        (
            lambda x: np.clip(x, -500, 500),
            {"saturated_share"},
            r"tau\[2\] of .* is at its largest value, 500 N, in 17 % of the",
        ),
    ],
)
def test_wrong_efforts(tau: Any, fails: set[str], said: str):
    outcome = solve(tau=tau)
    assert fails <= failed(outcome) and "name the alarm in accept" in outcome.message
    assert outcome.message.count("the notes say") == 1
    assert any(re.search(said, s) for s in outcome.notes), outcome.notes
    # each has a key that overrides it; it is said all the same
    names = tuple(name.removesuffix("_J") for name in fails)
    again = solve(tau=tau, accept=names)
    assert not fails & failed(again) and any(re.search(said, s) for s in again.notes)
    assert all(any(s.startswith(f"accepted ({name}): ") for s in again.notes) for name in names)
    assert again.parameters == outcome.parameters


@pytest.mark.parametrize(
    ("tau", "said"),
    [
        (lambda x: -x, r"log: every parameter would be negative \(m_p = .*check the signs"),
        (lambda x: 0 * x, r"log: tau\[0\], tau\[1\], tau\[2\] is always zero"),
    ],
)
def test_refused_efforts(tau: Any, said: str):
    with pytest.raises(ArgumentError, match=said):
        solve(tau=tau)


def test_a_clock_in_milliseconds():
    outcome = solve(seconds=1e3)
    assert any("times its nominal value; check the units of time" in s for s in outcome.notes)


def test_standing_still_with_a_noisy_sensor():
    still = np.asarray(simulator(16.0).truth["q"][:1]) + 1e-6 * np.random.default_rng(4).normal(size=(4000, 3))
    with pytest.raises(ArgumentError, match="does not exceed the position noise"):
        solve(q=still)


def test_a_coarse_position():
    coarse = 5e-4 * np.round(simulator(16.0).truth["q"] / 5e-4)
    with pytest.raises(ArgumentError, match=r"faster than 0.375 m/s"):
        solve(q=coarse)


def test_a_position_without_steps_but_with_noise():
    # 0.1 mm: the noise must set neither the cut-off nor the sign of a slow velocity
    q = simulator(16.0).truth["q"]
    outcome = solve(q=q + 1e-4 * np.random.default_rng(5).normal(size=q.shape))
    assert outcome.cutoff < 10.0 and 0.02 < outcome.dropped_share < 0.3
    for name, value in truth().items():
        if name.startswith(("coulomb", "viscous")):
            assert outcome.parameters[name] == pytest.approx(value, rel=0.04)
    assert outcome.parameters["m_p"] == pytest.approx(plant().m_p, abs=0.6)


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_a_copy_is_refused_wherever_it_is_said_to_be(shift: float):
    """Positions that a constant moved differ in their digits; the noise of the efforts does not."""
    t = simulator(16.0).truth
    clean = t["tau"] + NOISE * np.random.default_rng(3).normal(size=t["tau"].shape)
    half = len(clean) // 2
    q = t["q"] + 1e-3 * np.random.default_rng(4).normal(size=t["q"].shape)
    q[half : 2 * half] = q[:half] + shift
    with pytest.raises(ArgumentError, match="copies make the intervals too narrow"):
        solve(q=q, tau=lambda x: np.concatenate([clean[:half], clean[:half], clean[2 * half :]]))


def test_sixty_sound_logs_raise_no_suspicion_of_their_columns():
    from gtmodel.identify.checks import columns_compared

    for seed in range(60):
        rng = np.random.default_rng(seed)
        n, m, k = int(rng.integers(20, 400)), int(rng.integers(2, 5)), 5
        Y = rng.normal(size=(n * m, k))
        e = (Y @ rng.normal(size=k) + rng.uniform(1e-6, 3.0) * rng.normal(size=n * m)).reshape(n, m)
        Q = np.linalg.qr(Y)[0]

        def left(efforts, Q=Q):
            b = efforts.reshape(-1)
            return float(b @ b - np.sum((Q.T @ b) ** 2))

        found = columns_compared([f"tau[{j}]" for j in range(m)], e, left, n * m - k)
        assert found is not None and found.passed
