"""A delay between efforts and positions: found with its sign, named with what it moves, and not seen where none is."""

from __future__ import annotations

from dataclasses import replace

import pytest

import gtmodel as gt
from gtmodel.identify import Sensors, identify, rows_of
from gtmodel.inference import binomial_band
from gtmodel.measurements import Session
from gtmodel.results import TrajectoryError

from .plants import NOISE, SAMPLE_TIME, regressor, session, truth

SHIFTS = (-2, -1, 1, 3)  # samples by which the efforts come later
RUNS = 60  # by seeds fixed beforehand


def shifted(seed: int, samples: int, duration: float = 20.0) -> Session:
    t = session(Sensors(1e-6, NOISE), seed, duration).trajectory
    n = len(t) - abs(samples)
    late, early = slice(max(samples, 0), max(samples, 0) + n), slice(max(-samples, 0), max(-samples, 0) + n)
    log = gt.Trajectory(t.time[:n], {"q": t["q"][late], "tau": t["tau"][early]}, {"q": "m", "tau": "N"})
    return Session("shifted", log, SAMPLE_TIME)


@pytest.mark.parametrize("samples", SHIFTS)
def test_a_shift_is_estimated_and_what_it_moves_is_told(samples: int) -> None:
    found = identify(rows_of(shifted(3, samples), regressor()), nonnegative=False)
    delay = found.delay
    assert delay is not None and not delay.passed
    assert abs(delay.seconds - samples * SAMPLE_TIME) < max(5 * delay.std, 0.05 * abs(samples) * SAMPLE_TIME)
    e = found.estimate
    off = {n: abs(e.value(n) - truth()[n]) / s for n, s in zip(e.names, e.std, strict=True)}
    # the parameter that it names is off by about as much as it says
    assert off[delay.moved] == pytest.approx(delay.moves, abs=4) and delay.moves > 3
    late = "efforts" if samples > 0 else "positions"
    assert any(s.startswith(f"the {late} look") and delay.moved in s for s in found.notes)


def test_logs_without_a_delay_raise_as_many_alarms_as_chance_does() -> None:
    told = [identify(rows_of(shifted(s, 0), regressor()), nonnegative=False, test=[]).delay for s in range(RUNS)]
    assert all(d is not None and d.passed for d in told)
    low, high = binomial_band(RUNS, 0.2)
    assert low <= sum(d.p < 0.2 for d in told if d is not None) <= high


def test_copied_recordings_are_refused() -> None:
    one = shifted(1, 0)
    half = Session("half", _part(one), SAMPLE_TIME)
    with pytest.raises(TrajectoryError, match=r"samples of 'half' repeat"):
        rows_of([one, half], regressor())


def _part(s: Session) -> gt.Trajectory:
    t = s.trajectory
    return gt.Trajectory(t.time[1000:3000], {n: t[n][1000:3000] for n in ("q", "tau")}, {"q": "m", "tau": "N"})


def test_the_bound_on_held_out_errors_grows_with_few_rows() -> None:
    rows = rows_of(shifted(5, 0), regressor())
    first = {name: getattr(rows, name)[:8] for name in ("Y", "y0", "effort", "time", "position", "velocity")}
    short = replace(rows, starts=(0,), **first)
    whole, few = (identify(r, nonnegative=False, test=[]).validate(rows) for r in (rows, short))
    assert all(h.bound == 1.5 for h in whole.judged)
    assert all(h.bound > 2.0 and h.passed for h in few.judged)
