"""Dry friction with a stuck mode, which depends on the unknown torque of the same instant."""

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


FACE = TEXT[: TEXT.index("model Drive")]


def _run(folder: Path, body: str, end: float) -> gt.Simulation:
    file = folder / "drive.mo"
    file.write_text(f"{FACE}model Drive {body} end Drive;", encoding="utf-8")
    return gt.simulate(gt.modelica.load(f"{file}:Drive")(), end, tolerance=1e-8)


@pytest.mark.parametrize("speed", [0.0, 1.0, 1234.567])
@pytest.mark.parametrize(("slip", "rates"), [(2.0, (0.25, 0.25)), (0.1, (0.4, 0.1))])
def test_bodies_at_one_speed_stick_or_slip(
    tmp_path: Path, speed: float, slip: float, rates: tuple[float, float]
) -> None:
    run = _run(
        tmp_path,
        f"Real w1(start={speed}, fixed=true), w2(start={speed}, fixed=true); Dry c(slip={slip}); "
        "equation der(w1) = 0.5 - c.tau; c.w = w1 - w2; der(w2) = c.tau;",
        1.0,
    )
    # constant rates: round-off of the speed
    ends = [float(run.trajectory[n][-1]) - speed for n in ("w1", "w2")]
    np.testing.assert_allclose(ends, rates, atol=1e-12 * max(speed, 1.0))


# load, what the clutch and the brake hold, and what each inertia of 1 then gains in 1 s
AT_REST = [(0.0, 2.0, 1.0, 0.0, 0.0), (0.5, 2.0, 1.0, 0.0, 0.0), (2.0, 1.0, 4.0, 1.0, 0.0), (2.0, 4.0, 1.0, 0.5, 0.5)]


@pytest.mark.parametrize(("load", "clutch", "brake", "first", "second"), AT_REST)
def test_a_clutch_and_a_brake_at_rest(
    tmp_path: Path, load: float, clutch: float, brake: float, first: float, second: float
) -> None:
    run = _run(
        tmp_path,
        f"Real w1(start=0, fixed=true), w2(start=0, fixed=true); Dry c1(slip={clutch}), c2(slip={brake}); "
        f"equation der(w1) = {load} - c1.tau; c1.w = w1 - w2; der(w2) = c1.tau - c2.tau; c2.w = w2;",
        1.0,
    )
    np.testing.assert_allclose([run.trajectory[n][-1] for n in ("w1", "w2")], [first, second], atol=1e-12)


@pytest.mark.parametrize("seed", [8, *(pytest.param(n, marks=pytest.mark.proof) for n in (0, 1, 2, 3, 4, 5, 6, 7, 9))])
def test_drawn_chains_of_three(tmp_path: Path, seed: int) -> None:
    """Synthetic chains, drawn with this seed and without noise; by a regularised friction too."""
    rng = np.random.default_rng(seed)
    j, slip = rng.uniform(0.1, 0.6, 3).tolist(), rng.uniform(1.0, 5.0, 3).tolist()
    size, w, mean = rng.uniform(4.0, 12.0), rng.uniform(2.0, 6.0), rng.uniform(-3.0, 3.0)
    start = (rng.uniform(-6.0, 6.0, 3) * (rng.uniform(size=3) > 0.3)).tolist()
    end, soft = 1.5, 1e-5

    def rates(t: float, y: np.ndarray) -> list[float]:
        t1, t2, t3 = slip * np.tanh(np.append(y[:2] - y[1:], y[2]) / soft)
        return [(size * np.sin(w * t) + mean - t1) / j[0], (t1 - t2) / j[1], (t2 - t3) / j[2]]

    there = scipy.integrate.solve_ivp(rates, (0.0, end), start, method="Radau", rtol=1e-7, atol=1e-8, max_step=0.02)
    speeds = ", ".join(f"w{n + 1}(start={v!r}, fixed=true)" for n, v in enumerate(start))
    faces = ", ".join(f"c{n + 1}(slip={v!r})" for n, v in enumerate(slip))
    run = _run(
        tmp_path,
        f"Real {speeds}; Dry {faces}; equation "
        f"{j[0]!r}*der(w1) = {size!r}*sin({w!r}*time) + ({mean!r}) - c1.tau; c1.w = w1 - w2; "
        f"{j[1]!r}*der(w2) = c1.tau - c2.tau; c2.w = w2 - w3; {j[2]!r}*der(w3) = c2.tau - c3.tau; c3.w = w3;",
        end,
    )
    # what sticks creeps in the regularised one by some widths of the step of its tanh
    np.testing.assert_allclose([run.trajectory[f"w{n + 1}"][-1] for n in range(3)], there.y[:, -1], atol=20 * soft)
