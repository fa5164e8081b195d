"""Simulation of lead-through against a synthetic surface, and the gain at which its runs begin to grow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...linear.roots import bisected
from ...results import ArgumentError
from .calibration import calibrate_wrench
from .gains import SurfaceGains
from .law import SurfaceLaw
from .options import ConeComparison, ServoChain
from .scenes import GRAVITY, SyntheticSurface
from .sensor import sign_test
from .tool_run import ServoRun
from .wrench import WrenchStatus, rows_of, vector_of

AT_REST = 50  # readings before the start
QUARTERS = np.array([np.eye(3), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]], float)


@dataclass(frozen=True, eq=False)
class GuidedRun:
    """A synthetic run, a row per cycle (n,): time [s]; position, command (n, 3) [m], [m/s]; force (n, 3) [N] on the
    tool, without noise; guided (n, 3) [m/s] as in `SurfaceState`; normal (n, 3); contact (n,).

    status: of the last cycle, or of the sign test if it failed and the tool did not move.
    """

    time: np.ndarray
    position: np.ndarray
    command: np.ndarray
    force: np.ndarray
    guided: np.ndarray
    normal: np.ndarray
    contact: np.ndarray
    status: WrenchStatus


def guide(
    law: SurfaceLaw,
    handle: ArrayLike,
    surface: SyntheticSurface | None = None,
    servo: ServoChain | None = None,
    *,
    start: ArrayLike = (0.0, 0.0, 0.0),
    noise: float = 0.0,
    seed: int = 0,
    tool_mass: float = 0.8,
    sensor_sign: int = 1,
) -> GuidedRun:
    """Guide a tool by the handle forces (n, 3) [N], one row per cycle, against a synthetic surface.

    Args:
        start: (3,) [m] of the tool tip at rest; the surface passes through the origin.
        noise: standard deviation of the white noise of each component of the tool force [N]; seed: of the noise.
        tool_mass: [kg] of the tool carried by the sensor; its weight is used to test the sign before the first cycle.
        sensor_sign: -1 for a sensor that reports the force exerted by the tool.

    The transition of the servo is exact for held commands. Raises ArgumentError if shapes do not fit, if numbers are
    not finite, or if noise, tool_mass or sensor_sign is out of range.

    >>> L = gt.control.lead_through
    >>> run = L.guide(L.SurfaceLaw(), np.tile([5.0, 0.0, -5.0], (1000, 1)))
    >>> run.force[-1].round(2), run.status.name  # the reference of 2 N
    (array([0., 0., 2.]), 'OK')
    """
    surface, servo = surface or SyntheticSurface(), servo or ServoChain()
    hand, begin = rows_of(handle, "handle"), vector_of(start, "start")
    if not (np.isfinite(noise) and noise >= 0):
        raise ArgumentError(f"must be a number, at least 0; found {noise!r}", "noise")
    if not (np.isfinite(tool_mass) and tool_mass > 0):
        raise ArgumentError(f"must be a number above 0; found {tool_mass!r}", "tool_mass")
    if sensor_sign not in (1, -1):
        raise ArgumentError(f"must be 1 or -1; found {sensor_sign!r}", "sensor_sign")
    rng, count, cycle = np.random.default_rng(seed), len(hand), law.gains.cycle
    weight = tool_mass * np.array(GRAVITY)
    pulls = tool_mass * QUARTERS.transpose(0, 2, 1) @ np.array(GRAVITY)
    least = max(noise, 1e-3)
    known = calibrate_wrench(QUARTERS, pulls, 0 * pulls, sigma_force=least, sigma_moment=least)
    at_rest = sensor_sign * weight + noise * rng.standard_normal((AT_REST, 3))
    state = law.start(sign_test(known, np.eye(3), at_rest, sigma=least))

    chain = ServoRun(servo, cycle, begin)
    rows: dict[str, list[Any]] = {name: [] for name in ("position", "command", "force", "guided", "normal")}
    contact = np.zeros(count, bool)
    errors = noise * rng.standard_normal((count, 3))
    for k, (x, y, z) in enumerate(hand.tolist()):
        force = surface.force(chain.position, chain.velocity, k * cycle)
        fx, fy, fz = (sensor_sign * (force + weight) + errors[k] - weight).tolist()
        state = law.step(state, (x, y, z), (fx, fy, fz))
        for values, value in zip(
            rows.values(), (chain.position, state.velocity, force, state.guided, state.normal), strict=True
        ):
            values.append(value)
        contact[k] = state.contact
        chain.advance(np.array(state.velocity))
    tables = {name: np.array(values).reshape(count, 3) for name, values in rows.items()}
    return GuidedRun(cycle * np.arange(count), **tables, contact=contact, status=state.status)


CYCLES = 1000
LARGE = 0.1  # [N] from which the deviation has grown
SMALL = 1e-8  # [N] initial deviation: small enough for a linear contact
HALVINGS = 10  # of the range: a gain is accurate to two thousandths
FLOOR = 1e-12  # [N] below which the deviation is rounding noise
WIDE = 16  # zero padding of the spectrum, times its window
STIFFNESS = 5000.0  # arbitrary: the linear loop depends only on the product of gain and stiffness


def simulated_limit(gains: SurfaceGains, servo: ServoChain, near: float) -> tuple[float, float]:
    """Return the loop gain [1/s] at which a small deviation begins to grow, between half and twice `near`, and the
    frequency [Hz] of the growing oscillation. Raises ArgumentError if runs of 1000 cycles show no such gain.

    >>> L = gt.control.lead_through
    >>> limit = gt.control.delayed.gain_limit(L.force_loop(L.ServoChain()))
    >>> gain, frequency = L.simulated_limit(L.SurfaceGains(), L.ServoChain(), limit.gain)
    >>> bool(abs(gain / limit.gain - 1) < 0.05), bool(abs(frequency - limit.frequency) < 2.0)
    (True, True)
    """
    low, high = 0.5 * near, 2.0 * near
    if _grows(_run(gains, servo, low)) or not _grows(_run(gains, servo, high)):
        seconds = CYCLES * gains.cycle
        raise ArgumentError(
            f"runs of {seconds:g} s do not begin to grow at any gain between {low:.3g} and {high:.3g} 1/s"
        )
    low, high = bisected(lambda gain: not _grows(_run(gains, servo, float(gain))), low, high, HALVINGS)
    tail = _run(gains, servo, 1.03 * high)[CYCLES // 4 : CYCLES // 2]  # after the transient
    window = np.hanning(len(tail)) * (tail - tail.mean())
    spectrum = np.abs(np.fft.rfft(window, WIDE * len(tail)))
    return float(low), float(np.fft.rfftfreq(WIDE * len(tail), gains.cycle)[int(np.argmax(spectrum))])


def _run(gains: SurfaceGains, servo: ServoChain, loop_gain: float) -> np.ndarray:
    """Force minus its reference [N], on a surface with the nominal normal."""
    reference = max(gains.force_reference, 1.0)
    linear = replace(
        gains, force_gain=loop_gain / STIFFNESS, cone=0.0, any_direction=False, force_reference=reference,
        enter_force=reference / 2, leave_force=reference / 4, force_speed_limit=1e3, speed_limit=1e3,
        acceleration_limit=1e6,
    )  # fmt: skip
    start = (0.0, 0.0, -(reference + SMALL) / STIFFNESS)
    hand = np.zeros((CYCLES, 3))
    run = guide(SurfaceLaw(linear), hand, SyntheticSurface(stiffness=STIFFNESS), servo, start=start)
    return run.force[:, 2] - reference


def _grows(deviation: np.ndarray) -> bool:
    parts = np.array_split(deviation, 5)  # the first ones contain the transient
    late = float(np.std(parts[-1]))
    return bool(late > max(float(np.std(parts[2])), FLOOR) or np.abs(deviation).max() > LARGE)


def cone_deviations(gains: SurfaceGains, servo: ServoChain, comparison: ConeComparison) -> dict[str, list[float]]:
    """Return the root mean square of the force minus its reference [N] for each cone, on a flat and a tilted surface,
    without and with the filter; the keys are like "flat, unfiltered".

    >>> L = gt.control.lead_through
    >>> short = L.ConeComparison(cones=(0.0, 0.17), duration=4.0, seeds=1)
    >>> narrow, wide = L.cone_deviations(L.SurfaceGains(), L.ServoChain(), short)["flat, unfiltered"]
    >>> wide > narrow
    True
    """
    answers: dict[str, list[float]] = {}
    for surface, tilt in (("flat", 0.0), ("tilted", comparison.tilt)):
        for kind, constant in (("unfiltered", 0.0), ("filtered", comparison.constant)):
            answers[f"{surface}, {kind}"] = [
                _deviation(gains, servo, comparison, cone, constant, tilt) for cone in comparison.cones
            ]
    return answers


def _deviation(
    gains: SurfaceGains, servo: ServoChain, comparison: ConeComparison, cone: float, constant: float, tilt: float
) -> float:
    law = SurfaceLaw(replace(gains, force_gain=comparison.force_gain, cone=cone, normal_filter=constant, friction=0.0))
    p, k = law.gains, comparison.stiffness
    hand = np.tile([comparison.speed * p.damping, 0.0, 0.0], (round(comparison.duration / p.cycle), 1))
    off = []
    for seed in range(comparison.seeds):
        run = guide(
            law, hand, SyntheticSurface(stiffness=k, tilt=tilt), servo, start=(0.0, 0.0, -p.force_reference / k),
            noise=comparison.noise, seed=seed,
        )  # fmt: skip
        late = run.force[round(2.0 / p.cycle) :]
        off.append(np.mean((np.linalg.norm(late, axis=1) - p.force_reference) ** 2))
    return float(np.sqrt(np.mean(off)))
