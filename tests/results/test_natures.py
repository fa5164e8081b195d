"""Which numbers are taken for a rotation or a wrapped angle, and which are not.

Sets of the statistics, stated before they were run: plain columns of seeds 6000 to 6199, rotations and wrapped angles
of seeds 7000 to 7199.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.results import ArgumentError, TrajectoryError, interpolation
from gtmodel.results.interpolation import natures

PLAIN, TURNING = range(6000, 6200), range(7000, 7200)
NOISE = 1e-3  # rad, or of length 1
HOLD = 4  # rows at least of a setpoint; fewer, and what is beside a step tells nothing
TURN = 2 * np.pi
ROUNDING = 1e-12
CALLED = ("q{}", "q_{}", "Q[{}]", "pose.orientation.{}", "{}", "imu_{}_filtered")


def plain_columns(seed: int) -> gt.Trajectory:
    """3 to 9 columns of numbers that are no rotation and no wrapped angle (synthetic)."""
    rng = np.random.default_rng(seed)
    n, count = int(rng.integers(40, 400)), int(rng.integers(3, 10))
    t = np.cumsum(rng.uniform(0.5, 1.5, n) if seed % 2 else np.ones(n)) * 0.02
    noise, digits = NOISE * rng.integers(0, 2), int(rng.integers(3, 8))
    values, units = dict[str, np.ndarray](), dict[str, str]()
    share = np.exp(rng.uniform(0.5, 6.0) * np.sin(rng.uniform(0.2, 3, count) * t[:, None] + rng.uniform(0, 6, count)))
    share /= share.sum(axis=1, keepdims=True)
    shares, first = rng.random() < 0.3, rng.integers(0, 2)
    for k in range(count):
        kind = rng.choice(["smooth", "small", "step", "counter", "saw"])
        if shares or kind in ("smooth", "small"):
            level, size = (1.0 * (k == 0), 0.02) if kind == "small" else rng.uniform(0.1, 2.0, 2)
            x = share[:, k] if shares else level + size * np.sin(rng.uniform(0.3, 9) * t + rng.uniform(0, 6))
            unit = "1"
        elif kind == "step":
            x = np.repeat(rng.uniform(0, 6.28, n), rng.integers(HOLD, 30, n))[:n]
            unit = "rad"
        else:  # that begins again at a number which is no turn
            x = rng.uniform(0.02, 0.8) * np.arange(n)
            x, unit = (x % rng.uniform(3.5, 6.1) if kind == "saw" else x), "rad"
        values[f"c{k + first}"] = np.round(x + noise * rng.normal(size=n), digits)
        units[f"c{k + first}"] = unit
    values["modes"], units["modes"] = share[:, : min(count, 4)], "1"
    return gt.Trajectory(t, values, units, synthetic=f"seed {seed}, noise {noise:g}")


def turning_columns(seed: int) -> tuple[gt.Trajectory, set[tuple[str, ...]]]:
    """A turning body or an angle within a turn among plain columns, and what is to be seen (synthetic)."""
    rng = np.random.default_rng(seed)
    n, digits, what = int(rng.integers(60, 400)), int(rng.integers(3, 7)), seed % 5
    t = np.cumsum(rng.uniform(0.5, 1.5, n) if rng.random() < 0.5 else np.ones(n)) * 0.02
    angle = rng.uniform(0.5, 8.0) * (t - t[n // 2]) + rng.uniform(0, 0.5) * np.sin(rng.uniform(0.5, 3) * t)
    R = Rotation.from_rotvec(angle[:, None] * [0.0, 0.6, 0.8]) * Rotation.from_rotvec(
        rng.uniform(0.1, 0.8, 3) * np.sin(rng.uniform(0.3, 3.0, 3) * t[:, None])
    )
    q = R.as_quat(canonical=bool(rng.integers(0, 2))) + NOISE * rng.normal(size=(n, 4))
    M = (R * Rotation.from_rotvec(NOISE * rng.normal(size=(n, 3)))).as_matrix().reshape(n, 9)
    values, units, seen = {"flag": 0 * t, "level": 1 + 0.01 * np.sin(t)}, dict[str, str](), set[tuple[str, ...]]()
    if what == 0:
        values["q"], seen = q, {("q",)}
    elif what == 1:
        called, marks = CALLED[int(rng.integers(0, len(CALLED)))], ("xyzw", "wxyz", "XYZW", "0123", "1234")
        four = tuple(called.format(c) for c in marks[int(rng.integers(0, 5))])
        values |= dict(zip(four, q.T, strict=True))
        seen = {four}
    elif what == 2:
        values["R"], seen = M, {("R",)}
    elif what == 3:
        nine = tuple(f"r{i}" if seed % 2 else f"m_{i // 3 + 1}{i % 3 + 1}" for i in range(9))
        values |= dict(zip(nine, M.T, strict=True))
        seen = {nine}
    else:
        cut = float(rng.choice([0.0, np.pi]))
        a = (angle + NOISE * rng.normal(size=n)) % TURN - cut  # it passes the cut in the middle
        values["a"], units["a"], seen = a, "rad", {("a",)}
    return gt.Trajectory(t, {k: np.round(v, digits) for k, v in values.items()}, units, synthetic=f"seed {seed}"), seen


def test_plain_columns_are_plain_and_what_turns_is_seen() -> None:
    taken = [seed for seed in PLAIN if natures(plain_columns(seed))]
    drawn = {seed: turning_columns(seed) for seed in TURNING}
    missed = [seed for seed, (log, seen) in drawn.items() if set(natures(log)) != seen]
    assert not taken and not missed


def test_four_plain_columns_of_length_near_1_keep_every_bit() -> None:
    t = 0.1 * np.arange(50)
    ratios = {
        "efficiency": 1 + 0.004 * np.sin(t),
        "slip": 0.01 + 0.001 * t,
        "loss": 0.02 * np.cos(t),
        "noise": 0.03 * t,
    }
    log = gt.Trajectory(t, ratios)
    even = log.resample(t)
    assert not natures(log) and all(np.array_equal(even[n], log[n]) for n in log.names)


def test_at_its_own_times_a_rotation_is_as_it_was_recorded_and_between_them_of_length_1() -> None:
    log, _ = turning_columns(7000)
    even = log.resample(log.time)["q"]
    assert np.array_equal(np.abs(even), np.abs(log["q"]))
    between = log.resample(0.5 * (log.time[1:] + log.time[:-1]))["q"]
    np.testing.assert_allclose(np.linalg.norm(between, axis=1), 1.0, rtol=0, atol=ROUNDING)
    session = gt.measurements.session_of(gt.Trajectory(0.02 * np.arange(len(log)), {"q": log["q"]}))
    assert np.array_equal(np.abs(gt.measurements.motion(session, "q", None)["q"]), np.abs(log["q"][1:-1]))


@pytest.mark.parametrize("size", [3.5, 5.0, 6.28, TURN])
def test_a_setpoint_that_steps_is_no_angle_that_wraps(size: float) -> None:
    t = 0.1 * np.arange(21)
    log = gt.Trajectory(t, {"r": np.where(t < 0.95, 0.0, size)}, {"r": "rad"})
    assert np.array_equal(log.resample(t)["r"], log["r"])

    class Servo(gt.Model):
        phi = gt.variable(start=0.0, fixed=True, unit="rad")
        r = gt.input(unit="rad")
        T = gt.parameter(0.1, unit="s")

        def equations(self):  # type: ignore[no-untyped-def]
            yield self.T * gt.der(self.phi) == self.r - self.phi

    end = gt.simulate(Servo(), 2.0, inputs={"r": log}).trajectory["phi"][-1]
    # exponential approach over 10 and 11 time constants: the ramp of the table lasts one
    assert np.exp(-11) * size < size - end < np.exp(-9) * size


def test_an_angle_of_few_digits_that_creeps_across_pi_is_wrapped() -> None:
    t = 0.01 * np.arange(4000)
    slow = np.round((3.1 + 0.002 * t + np.pi) % TURN - np.pi, 3)  # a digit in half a second
    assert natures(gt.Trajectory(t, {"a": slow}, {"a": "rad"})) == {("a",): "angle"}


def test_of_a_vector_of_angles_those_that_wrap_are_unwrapped() -> None:
    k = np.arange(30)
    wrapped, fast, step = (0.5 * k + 3) % TURN, 5.0 * k, np.where(k < 15, 0.0, 5.0)
    log = gt.Trajectory(0.1 * k, {"q": np.column_stack([wrapped, fast, step])}, {"q": "rad"})
    even = log.resample(log.time)["q"]
    np.testing.assert_allclose(even[:, 0], 0.5 * k + 3, rtol=0, atol=ROUNDING)
    assert np.array_equal(even[:, 1:], log["q"][:, 1:])
    np.testing.assert_array_equal(gt.measurements.smooth(log)["q"], even)
    np.testing.assert_array_equal(log(0.25, "q[0]"), log(0.25, "q")[0])


def test_a_direction_of_five_digits_stays_one_and_a_plain_vector_near_it_does_not() -> None:
    t = 0.1 * np.arange(40)
    tool = np.round(np.column_stack([np.cos(t), 0.6 * np.sin(t), 0.8 * np.sin(t)]), 5)
    near = np.column_stack([1 + 0 * t, 0.003 * np.sin(t), 0.003 * np.cos(t)])
    assert natures(gt.Trajectory(t, {"tool": tool, "near": near})) == {("tool",): "direction"}


def test_four_scalar_inputs_of_one_trajectory_go_together() -> None:
    t = 0.1 * np.arange(21)
    sign = np.where(np.arange(21) % 2, -1.0, 1.0)
    values = {"qw": sign * np.cos(t), "qx": sign * np.sin(t), "qy": 0 * t, "qz": 0 * t}
    log = gt.Trajectory(t, values)

    class Length(gt.Model):
        qw, qx, qy, qz = gt.input(), gt.input(), gt.input(), gt.input()
        n = gt.variable()

        def equations(self):  # type: ignore[no-untyped-def]
            yield self.n == self.qw**2 + self.qx**2 + self.qy**2 + self.qz**2

    made = gt.simulate(Length(), 2.0, step=0.05, inputs=dict.fromkeys(values, log)).trajectory["n"]
    assert made.min() > 0.99 * np.cos(0.05) ** 2  # the chord of 0.1 rad
    with pytest.raises(ValueError, match="'qx' is a unit quaternion"):
        gt.control.zero_vibration(5.0)(log, ["qx"])


def test_a_setpoint_of_an_orientation_is_not_told_to_be_recorded_faster() -> None:
    q = np.tile([0.0, 0.0, 0.0, 1.0], (40, 1))
    q[20:] = [0.0, 0.0, np.sin(1.0), np.cos(1.0)]
    log = gt.Trajectory(0.1 * np.arange(40), {"q": q})
    with pytest.raises(TrajectoryError, match=r"'q' turns by 114.6 deg .* like a setpoint: hold its rows"):
        log.resample(dt=0.05)
    assert np.array_equal(log.resample([0.5, 2.5], kind="previous")["q"], q[[5, 25]])


def test_the_rows_are_made_smooth_once(monkeypatch: pytest.MonkeyPatch) -> None:
    log, _ = turning_columns(7001)
    calls, plain = list[str](), interpolation.smooth_rows

    def counted(*args: Any) -> Any:
        calls.append(args[-1])
        return plain(*args)

    monkeypatch.setattr(interpolation, "smooth_rows", counted)
    name = log.names[-1]
    assert [log(t, name) for t in log.time[:5]] == [log(t, name) for t in log.time[:5]]
    assert len(calls) == 1


def test_times_that_are_no_numbers_are_said() -> None:
    log = gt.Trajectory(0.1 * np.arange(20), {"x": np.arange(20.0)})
    for ask in (lambda: log.resample(dt="a"), lambda: log.resample("a"), lambda: log("a", "x")):  # type: ignore[arg-type]
        with pytest.raises(TrajectoryError, match=r"^(t|dt) is 'a'; expected seconds, as numbers$"):
            ask()
    with pytest.raises(ArgumentError, match=r"^sample_time: "):
        gt.measurements.resample(log, "a")  # type: ignore[arg-type]
