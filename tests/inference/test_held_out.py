"""The bound on held-out over fitted errors: sound models fail it as seldom as is said, wrong ones fail it."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.inference import FALSE_ALARM, binomial_band, freedom_of, held_out_ratio

RUNS = 2000  # by seeds fixed beforehand; the band is the 99.9 % binomial one


@pytest.mark.parametrize(("equations", "parameters"), [(45, 26), (45, 40), (300, 13), (20, 1)])
@pytest.mark.parametrize("rate", [0.05, 0.01])
def test_drawn_sound_models_raise_as_many_false_alarms_as_said(equations: int, parameters: int, rate: float) -> None:
    rng = np.random.default_rng(equations + parameters)
    A, B = rng.normal(size=(2, equations, parameters))
    solve, hat = np.linalg.pinv(A), A @ np.linalg.pinv(A)
    noise, other = rng.normal(size=(2, RUNS, equations))
    fitted = noise - noise @ hat.T
    held = other - noise @ solve.T @ B.T
    ratio = np.sqrt(np.sum(held**2, axis=1) / np.sum(fitted**2, axis=1))
    S = np.eye(equations) + B @ np.linalg.inv(A.T @ A) @ B.T
    growth = float(np.trace(S)) / (equations - parameters)
    told = held_out_ratio(1.0, growth, equations - parameters, freedom_of(np.trace(S), np.sum(S * S)),
                          false_alarm=rate, matters=0.0)  # fmt: skip
    low, high = binomial_band(RUNS, rate)
    assert low <= np.count_nonzero(ratio > told.bound) <= high
    assert told.expected == pytest.approx(np.sqrt(np.mean(ratio**2)), rel=0.3 if equations - parameters < 8 else 0.1)


def test_26_parameters_of_45_equations_have_twice_the_error_and_are_sound() -> None:
    told = held_out_ratio(1.93, (45 + 26) / (45 - 26), 19, 30)
    assert told.passed and told.expected == pytest.approx(1.933, abs=1e-3) and told.false_alarm == FALSE_ALARM
    assert not held_out_ratio(6.0, (45 + 26) / (45 - 26), 19, 30).passed
    # many equations: what matters decides, and chance explains nothing more
    many = held_out_ratio(1.4, 1.01, 5000, 5000)
    assert many.passed and many.bound == 1.5 and not held_out_ratio(1.6, 1.01, 5000, 5000).passed


def test_without_freedom_nothing_is_judged() -> None:
    nothing = held_out_ratio(1.0, np.inf, 0, 30)
    assert nothing.bound == np.inf and not nothing.passed and "cannot be compared" in nothing.message
    assert freedom_of(10.0, 10.0) == 10.0 and freedom_of(2.0, 4.0) == 1.0 and freedom_of(0.0, 0.0) == 0.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", [float, np.float64])
def test_traces_of_large_covariances_do_not_overflow(kind) -> None:
    exact = freedom_of(3.1, 3.01)
    assert freedom_of(kind(3.1 * 2.0**520), kind(3.01) * 2.0**1020 * 2.0**2) == exact * 2.0**18
    assert freedom_of(kind(3.1 * 2.0**-520), kind(3.01 * 2.0**-1000)) == exact * 2.0**-40
