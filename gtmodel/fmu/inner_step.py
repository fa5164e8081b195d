"""The step of the integrator inside of co-simulation: compared with half of it, refused where it is too long."""

from __future__ import annotations

import math

import numpy as np

from ..compiler.causal import CausalFunction
from ..results.refusal import ArgumentError
from ..results.status import Status
from .causal_content import Pair
from .with_states import WithStates

LONGEST = 1e-3  # tried first [s]
HALVINGS = 6
AIM = 1e-8  # error of a step that is chosen
ORDER = 16.0  # what a halving divides the error by, of order 4
MOST_STEPS = 200_000
AWAY = 0.1


def step_and_error(
    made: WithStates, start: dict[Pair, float], step: float | None, tolerance: float, stop: float, guarded: bool = False
) -> tuple[float, float]:
    """The step [s] and its error: the largest difference of a state from a run in half the steps, over the size of the
    state or one, from the start to `stop`, or as far as there are answers, with inputs held a tenth of their size off
    the start, so that it moves.

    step: refused where its error is above `tolerance`; None: the longest of 1 ms, 0.5 ms, ... whose error is at most
    1e-8; where friction is too sharp for that, the longest whose error is at most `tolerance`. guarded: no part of it
    may be rougher than `tolerance`, see `_ends`, since the unit then judges each of its parts.
    Raises ArgumentError also for a start from which there is no way to `stop`.
    """
    if step is not None and stop / step > MOST_STEPS:
        raise ArgumentError(f"{stop:g} s in steps of {step:g} s are more than {MOST_STEPS} steps", "step")
    start = {**start, **{p: start[p] + AWAY * max(1.0, abs(start[p])) for s in made.known for p in s.pairs if not p[1]}}
    tried = [step] if step is not None else [LONGEST / 2**k for k in range(HALVINGS)]
    coarse, rough = _ends(made, start, tried[0], stop)
    error, last, good = math.inf, math.inf, None
    aim = tolerance if step is not None else min(AIM, tolerance)
    for n, h in enumerate(tried):
        fine, rough_half = _ends(made, start, h / 2, stop)
        shared = fine[::2][: len(coarse)]
        error = float(np.max(np.abs(shared - coarse[: len(shared)]) / np.maximum(1.0, np.abs(shared)), initial=0.0))
        smooth = not guarded or rough <= tolerance
        if error <= aim and smooth:
            return h, error
        if error <= tolerance and smooth and good is None:
            good = h, error
        if good is not None and error / ORDER ** (len(tried) - n - 1) > aim:
            break
        coarse, last, rough = fine, rough, rough_half
    if good is not None:
        return good
    if error <= tolerance:
        raise ArgumentError(
            f"one part of an inner step of {tried[-1]:g} s is off by {last:.1e}, more than {tolerance:g}; take a "
            "smaller step, a larger tolerance, or smoother friction",
            "step",
        )
    raise ArgumentError(
        f"an inner step of {tried[-1]:g} s is off by {error:.1e} within {stop:g} s, more than {tolerance:g}; "
        "take a smaller step, a larger tolerance, or smoother friction",
        "step",
    )


def _ends(made: WithStates, start: dict[Pair, float], h: float, stop: float) -> tuple[np.ndarray, float]:
    """States (steps + 1, n) at the ends of equal steps, as far as there is an answer, and the largest difference of a
    state, over its size or one, from one step of order 3, which takes the rates at its end in place of the fourth."""
    f, order = made.function, [p for s in made.states for p in s.pairs]
    place = {p: n for n, p in enumerate(order)}
    targets = {p: (n, k) for n, s in enumerate(f.outputs) for k, p in enumerate(s.pairs)}
    rates = [(place[i, m + 1], None) if (i, m + 1) in place else (0, targets[i, m + 1]) for i, m in order]

    def rate(x: np.ndarray, t: float) -> np.ndarray | None:
        values = {**start, **dict(zip(order, x, strict=True))}
        results = _results(f, values, t)
        if results is None:
            return None
        return np.array([x[n] if at is None else results[at[0]][at[1]] for n, at in rates])

    x = np.array([start[p] for p in order])
    rows = [x]
    n = max(1, math.ceil(stop / h - 1e-9))
    h = stop / n
    rough, k4 = 0.0, None
    for k in range(n):
        t = k * h
        k1 = rate(x, t)
        if k1 is not None and k4 is not None:
            rough = max(rough, float(np.max(np.abs(h / 6 * (k4 - k1)) / np.maximum(1.0, np.abs(x)), initial=0.0)))
        k2 = None if k1 is None else rate(x + h / 2 * k1, t + h / 2)
        k3 = None if k2 is None else rate(x + h / 2 * k2, t + h / 2)
        k4 = None if k3 is None else rate(x + h * k3, t + h)
        if k1 is None or k2 is None or k3 is None or k4 is None:
            break
        x = x + h / 6 * (k1 + k4 + 2 * (k2 + k3))
        rows.append(x)
    if len(rows) < min(n, 4):
        raise ArgumentError("from the start there is no answer after the first steps; give another start", "start")
    return np.array(rows), rough


def _results(f: CausalFunction, values: dict[Pair, float], t: float) -> list[np.ndarray] | None:
    columns = [np.array([values[p] for p in s.pairs]) for s in f.inputs]
    shaped = [c.reshape(s.shape) if s.shape else float(c[0]) for c, s in zip(columns, f.inputs, strict=True)]
    *results, status = f(*shaped, *([t] if f.plan.uses_time else []))
    return [np.ravel(r) for r in results] if Status(int(status)) is Status.OK else None
