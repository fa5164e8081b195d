"""Random loops, plant and delay alike: limits and margins against scans of a matrix of its own that know no
crossings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel.results import ArgumentError

D = gt.control.delayed
ROUNDING = 1e-9  # of a modulus of an eigenvalue: defective poles of some 30 states
ON_CIRCLE = 1e-6
LONGEST = 12  # cycles of further delay that a scan looks at


def matrix(plant: Any, cycle: float, delay: float, gain: float) -> np.ndarray:
    """Companion matrix, by matrix exponentials of the plant with its held correction."""
    n, whole = len(plant.A), int(np.floor(delay / cycle + 1e-12))
    rest = max(delay - whole * cycle, 0.0)

    def held(span: float) -> tuple[np.ndarray, np.ndarray]:
        block = np.block([[plant.A, plant.B[:, None]], [np.zeros((1, n + 1))]])
        both = scipy.linalg.expm(block * span)
        return both[:n, :n], both[:n, n]

    (_, before), (after, new) = held(rest), held(cycle - rest)
    size = n + whole + 1
    sent = np.zeros((whole + 2, size))  # row j: the correction of j samples ago
    sent[0, :n] = -gain * plant.C
    sent[1:, n:] = np.eye(whole + 1)
    rows = np.zeros((size, size))
    rows[:n, :n] = held(cycle)[0]
    rows[:n] += np.outer(new, sent[whole]) + np.outer(after @ before, sent[whole + 1])
    rows[n:] = sent[: whole + 1]
    return rows


def radius(*of: Any) -> float:
    return float(np.abs(np.linalg.eigvals(matrix(*of))).max())


def some_plant(rng: np.random.Generator, cycle: float) -> Any:
    """One to three parts side by side: oscillators of any damping, also above the Nyquist frequency, lags, rigid arms;
    of several some have the wrong sign."""
    parts, count = [], int(rng.integers(1, 4))
    for kind in rng.choice(["oscillator", "oscillator", "light", "fast", "lag", "rigid"], count):
        w = np.pi * 10 ** rng.uniform(-2, 0.2) / cycle * (3 if kind == "fast" else 1)
        zeta = 10 ** (rng.uniform(-5, -2.5) if kind == "light" else rng.uniform(-2.5, 0))
        share = float(rng.choice([1, 1, 1, -0.3])) if count > 1 else 1.0
        if kind == "rigid":
            parts.append(D.CorrectedPlant([[0.0]], [0.3 / cycle], [1.0]))
        elif kind == "lag":
            parts.append(D.CorrectedPlant([[-w]], [w], [share]))
        else:
            size = share * 10 ** rng.uniform(-1, 1)
            parts.append(D.CorrectedPlant([[0, 1], [-w * w, -2 * zeta * w]], [0, w * w], [size, 0]))
    return D.side_by_side(parts, [1.0] * count, [1.0] * count)


def some_delay(rng: np.random.Generator) -> float:
    """Cycles: none, whole ones, any, and within a millionth of a whole one."""
    whole = int(rng.integers(1, 20))
    return float(rng.choice([0.0, rng.uniform(0, 3), whole, rng.uniform(0, 20), whole + 1e-6, whole - 1e-6]))


def check_limit(rng: np.random.Generator) -> bool:
    """Whether there was a limit to check."""
    cycle = 10 ** rng.uniform(-3.3, -1)
    plant, delay = some_plant(rng, cycle), some_delay(rng) * cycle
    try:
        limit = D.gain_limit(D.DelayedLoop(plant, cycle, delay))
    except ArgumentError:
        small = [radius(plant, cycle, delay, gain) for gain in (1e-7, 1e-6, 1e-5)]
        assert min(small) > 1 - 1e-12  # not at rest by itself, or made unstable by small gains
        return False
    assert radius(plant, cycle, delay, limit.gain) == pytest.approx(1, abs=ON_CIRCLE)
    for share in [*np.linspace(0.002, 0.9999, 100), *np.geomspace(1e-5, 0.9999, 40)]:
        assert radius(plant, cycle, delay, share * limit.gain) < 1 + ROUNDING, share
    beyond = [radius(plant, cycle, delay, limit.gain * (1 + step)) for step in (1e-5, 1e-4)]
    assert max(beyond) > 1
    for low, high in limit.returns:
        inside = low + (high - low) * np.array([0.01, 0.3, 0.7, 0.99])
        assert all(radius(plant, cycle, delay, gain) < 1 + ROUNDING for gain in inside)
    # between the ranges it is unstable
    edges = [limit.gain, *np.ravel(limit.returns), 10 * max([limit.gain, *np.ravel(limit.returns)])]
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        inside = low + (high - low) * np.array([0.01, 0.3, 0.7, 0.99])
        assert all(radius(plant, cycle, delay, gain) > 1 - ROUNDING for gain in inside)
    return True


def check_margins(rng: np.random.Generator) -> bool:
    cycle = 0.004
    plant, delay = some_plant(rng, cycle), float(rng.choice([0.0, rng.uniform(0, 3), rng.integers(0, 14)])) * cycle
    loop = D.DelayedLoop(plant, cycle, delay)
    try:
        gain = D.gain_limit(loop).gain * float(rng.choice([0.2, 0.5, 0.8, 0.95, 0.99]))
    except ArgumentError:
        return False
    margins = D.loop_margins(loop, gain)
    for factor in [*np.linspace(1, margins.gain, 50)[:-1], *np.linspace(margins.gain_below, 1, 20)[1:]]:
        assert radius(plant, cycle, delay, gain * factor) < 1 + ROUNDING
    assert radius(plant, cycle, delay, gain * margins.gain) == pytest.approx(1, abs=ON_CIRCLE)
    further = min(margins.delay, LONGEST * cycle)
    for share in np.linspace(0, 0.9999, 300):
        assert radius(plant, cycle, delay + share * further, gain) < 1 + ROUNDING, share
    if np.isfinite(margins.delay):
        assert radius(plant, cycle, delay + margins.delay, gain) == pytest.approx(1, abs=ON_CIRCLE)
    w = np.unique(np.concatenate([np.linspace(1e-4, 1, 20000), np.geomspace(1e-7, 1, 5000)])) * np.pi / cycle
    L = gain * loop.response(w)
    assert margins.disk <= np.min(2 * np.abs(1 + L) / np.abs(1 - L)) * (1 + 1e-6)
    near_one = np.flatnonzero(np.diff(np.sign(np.abs(L) - 1)))
    turns = np.minimum(np.abs(np.angle(-L[near_one])), np.abs(np.angle(-L[near_one + 1])))
    steps = np.abs(np.angle(L[near_one + 1] / L[near_one]))
    assert margins.phase <= np.min(turns + steps, initial=np.pi) + 1e-9
    return True


def count(check: Any, seed: int, draws: int) -> int:
    """Of some draws, how many had something to check; a failure names its draw."""
    done = 0
    for draw in range(draws):
        try:
            done += check(np.random.default_rng([seed, draw]))
        except AssertionError as failed:
            raise AssertionError(f"seed {seed}, draw {draw}: {failed}") from failed
    return done


def test_limits_of_random_loops_are_the_first_of_a_scan() -> None:
    assert count(check_limit, 1, 20) > 16


def test_margins_of_random_loops_are_those_of_a_scan() -> None:
    assert count(check_margins, 2, 5) > 3


@pytest.mark.proof
def test_limits_of_many_random_loops() -> None:
    assert count(check_limit, 3, 1000) > 900


@pytest.mark.proof
def test_margins_of_many_random_loops() -> None:
    assert count(check_margins, 4, 150) > 120
