"""Dry friction of a text with a stuck mode, whose torque decides on the mode: the sides are unknowns of the instant."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import scipy

import gtmodel as gt

# two inertias on a clutch, the second one on a brake; either may stick while the other slides
TEXT = """
partial model Face "Coulomb friction by a path parameter"
  Real w, a, tau, sa;
  parameter Real slip, peak = 1;
  Boolean forward(start = false, fixed = true), backward(start = false, fixed = true), locked(start = false);
  Integer mode(start = 3, fixed = true) "1 forward, 0 stuck, -1 backward, 3 unknown";
equation
  a = der(w);
  forward = pre(mode) == 0 and (sa > peak*slip or pre(forward) and sa > slip) or initial() and w > 0;
  backward = pre(mode) == 0 and (sa < -peak*slip or pre(backward) and sa < -slip) or initial() and w < 0;
  locked = not (pre(mode) == 1 or forward or pre(mode) == -1 or backward);
  a = if locked then 0 elseif forward or pre(mode) == 1 then sa - peak*slip else sa + peak*slip;
  mode = if (pre(mode) == 1 or forward) and w > 0 then 1 elseif (pre(mode) == -1 or backward) and w < 0 then -1 else 0;
  tau = if locked then sa elseif forward or pre(mode) == 1 then slip else -slip;
end Face;
model Dry extends Face; end Dry;
model Drive
  Real w1(start = 10, fixed = true), w2(start = 2, fixed = true);
  Dry clutch(slip = 4), brake(slip = 3.5);
equation
  0.2*der(w1) = 6*sin(3*time) - clutch.tau;
  0.4*der(w2) = clutch.tau - brake.tau;
  clutch.w = w1 - w2;
  brake.w = w2;
end Drive;
"""
SLIP, BRAKE, END = 4.0, 3.5, 3.35


def _by_phases() -> tuple[list[float], np.ndarray]:
    """Instants of sticking and breaking away, and the speeds at the end: each phase by itself, with its own states."""

    def torques(t: float, sliding: list[float]) -> tuple[float, float, float]:
        """Of the motor, the clutch and the brake; what sticks takes what keeps it there."""
        motor = 6 * np.sin(3 * t)
        if sliding[0] and sliding[1]:
            return motor, SLIP * sliding[0], BRAKE * sliding[1]
        if sliding[0]:
            return motor, SLIP * sliding[0], SLIP * sliding[0]
        if sliding[1]:  # both inertias as one
            return motor, motor - (motor - BRAKE * sliding[1]) / 3, BRAKE * sliding[1]
        return motor, motor, motor

    t, y, sliding, times = 0.0, np.array([10.0, 2.0]), [1.0, 1.0], []
    while t < END:
        now = list(sliding)

        def rates(t: float, y: np.ndarray, now: list[float] = now) -> list[float]:
            motor, clutch, brake = torques(t, now)
            return [(motor - clutch) / 0.2, (clutch - brake) / 0.4]

        def stays(t: float, y: np.ndarray, now: list[float] = now, n: int = 0) -> float:
            """Above zero while this one slides on, or sticks on."""
            if now[n]:
                return now[n] * (y[0] - y[1] if n == 0 else y[1])
            return (SLIP, BRAKE)[n] - abs(torques(t, now)[n + 1])

        ends = [partial(stays, n=n) for n in range(2)]
        for end in ends:
            end.__dict__.update(terminal=True, direction=-1)
        run = scipy.integrate.solve_ivp(rates, (t, END), y, rtol=1e-11, atol=1e-12, max_step=0.02, events=ends)
        t, y = float(run.t[-1]), run.y[:, -1].copy()
        for n, hits in enumerate(run.t_events):
            if len(hits):
                times.append(t)
                if now[n]:
                    y[n] = y[1] if n == 0 else 0.0
                    sliding[n] = 0.0
                else:
                    sliding[n] = float(np.sign(torques(t, now)[n + 1]))
        for n in range(2):  # one that stays stuck is asked again with the other's new torque
            if not sliding[n] and abs(wanted := torques(t, sliding)[n + 1]) > (SLIP, BRAKE)[n] * (1 + 1e-9):
                sliding[n] = float(np.sign(wanted))
    return times, y


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> gt.Simulation:
    file: Path = tmp_path_factory.mktemp("friction") / "drive.mo"
    file.write_text(TEXT, encoding="utf-8")
    return gt.simulate(gt.modelica.load(f"{file}:Drive")(), END)


def test_a_clutch_and_a_brake_stick_and_break_away_when_they_should(drive: gt.Simulation) -> None:
    times, speeds = _by_phases()
    found = [e.time for e in drive.events if e.time > 0]
    assert len(found) == len(times) >= 8
    # both integrate to 1e-9; an instant is a speed over an acceleration of the order of one
    np.testing.assert_allclose(found, times, atol=1e-7)
    np.testing.assert_allclose([drive.trajectory[n][-1] for n in ("w1", "w2")], speeds, atol=1e-7)
