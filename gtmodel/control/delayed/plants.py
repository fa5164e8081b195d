"""Plants of delayed feedback: the equivalent-force oscillator, a rigid arm, or any linearised model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._lazy import hint
from ...results import ArgumentError

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")

MOST_CYCLES = 2000  # of delay: the companion matrix has a state for each


@dataclass(frozen=True, eq=False)
class CorrectedPlant:
    """A plant x' = A x + B u, y = C x; u is the correction, held over one cycle, and y the measured deviation.

    A (n, n), B (n,), C (n,). For an arm both u and y are in m. Raises ArgumentError if shapes do not fit or numbers are
    not finite.

    >>> plant = gt.control.delayed.rigid_plant(cycle=0.004)
    >>> plant.A.shape, plant.B  # moves by the correction in one cycle
    ((1, 1), array([250.]))
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray

    def __post_init__(self) -> None:
        a = np.atleast_2d(np.asarray(self.A, float))
        b, c = np.asarray(self.B, float).reshape(-1), np.asarray(self.C, float).reshape(-1)
        if a.shape != (len(b), len(b)) or len(c) != len(b) or not len(b):
            raise ArgumentError(f"A {a.shape}, B {b.shape}, C {c.shape} do not fit; expected one input and one output")
        if not all(np.all(np.isfinite(x)) for x in (a, b, c)):
            raise ArgumentError("A, B and C must hold finite numbers only")
        for name, value in (("A", a), ("B", b), ("C", c)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.A)


def equivalent_plant(m: float, c: float, k: float, cycle: float, *, accumulate: bool = False) -> CorrectedPlant:
    """Return m x'' + c x' + k x = u / cycle^2 for a correction u [m] of one cycle [s] (Cvitanic 2021, eq. (30)).

    m [1], c [1/s] and k [1/s2] are equivalent values: the force is an acceleration, and a free unit mass moves by u/2
    in the cycle. `accumulate`: the correction also moves the arm by u, at constant speed over the cycle, and the arm
    stays there. Otherwise the correction only causes vibration, as in the simulations of the thesis. Raises
    ArgumentError if m, k or cycle is not positive, or if c is negative.

    >>> plant = gt.control.delayed.equivalent_plant(m=3.0, c=57.7, k=34200.0, cycle=0.004)
    >>> (np.abs(np.linalg.eigvals(plant.A)) / (2 * np.pi)).round(1)  # natural frequency [Hz]
    array([17., 17.])
    """
    for name, value in (("m", m), ("k", k), ("cycle", cycle)):
        if not (np.isfinite(value) and value > 0):
            raise ArgumentError(f"must be a number above 0; found {value!r}", name)
    if not (np.isfinite(c) and c >= 0):
        raise ArgumentError(f"must be a number, at least 0; found {c!r}", "c")
    a, b = np.array([[0.0, 1.0], [-k / m, -c / m]]), np.array([0.0, 1 / (m * cycle**2)])
    vibration = CorrectedPlant(a, b, np.array([1.0, 0.0]))
    return side_by_side([vibration, rigid_plant(cycle)], [1.0, 1.0], [1.0, 1.0]) if accumulate else vibration


def rigid_plant(cycle: float) -> CorrectedPlant:
    """Return an arm without vibration that moves by each correction, at constant speed over the cycle [s].

    Raises ArgumentError if the cycle is not positive.

    >>> loop = gt.control.delayed.DelayedLoop(gt.control.delayed.rigid_plant(0.004), cycle=0.004, delay=0.052)
    >>> round(gt.control.delayed.gain_limit(loop).gain, 4)  # 2 sin(pi / (2 (2 * 13 + 1)))
    0.1163
    """
    if not (np.isfinite(cycle) and cycle > 0):
        raise ArgumentError(f"must be a number above 0; found {cycle!r}", "cycle")
    return CorrectedPlant(np.zeros((1, 1)), np.array([1 / cycle]), np.array([1.0]))


def side_by_side(
    plants: Sequence[CorrectedPlant], into: Sequence[float], out_of: Sequence[float]
) -> CorrectedPlant:  # fmt: skip
    """Connect plants in parallel: each gets its share `into` of the correction and adds its deviation times `out_of`.

    In a direction with components s, c along two axes, both shares are (s, c), and the plant is s^2 G_x + c^2 G_y.
    Raises ArgumentError if the numbers of plants and shares differ.

    >>> soft, stiff = (gt.control.delayed.equivalent_plant(m, 40.0 * m, 1.2e4 * m, 0.004) for m in (0.3, 4.0))
    >>> s = np.sqrt(0.5)
    >>> len(gt.control.delayed.side_by_side([stiff, soft], [s, s], [s, s]))  # states
    4
    """
    if not len(plants) == len(into) == len(out_of) or not plants:
        raise ArgumentError(f"{len(plants)} plants need as many shares; found {len(into)} and {len(out_of)}")
    size = sum(len(p) for p in plants)
    a, first = np.zeros((size, size)), 0
    for p in plants:
        a[first : first + len(p), first : first + len(p)] = p.A
        first += len(p)
    b = np.concatenate([share * p.B for p, share in zip(plants, into, strict=True)])
    c = np.concatenate([share * p.C for p, share in zip(plants, out_of, strict=True)])
    return CorrectedPlant(a, b, c)


def linear_plant(system: StateSpace, direction: Any = None, measured: Any = None) -> CorrectedPlant:
    """Return the plant of a continuous-time linear model, for example from `gt.linearize`.

    Args:
        system: from corrections to positions.
        direction: (inputs,) contribution of a unit correction to each input; 1 by default for one input.
        measured: (outputs,) weights of the outputs in the deviation; 1 by default for one output.

    Raises ArgumentError for a discrete-time model, for direct feedthrough (D), and if shapes do not fit.

    >>> import control
    >>> plant = gt.control.delayed.linear_plant(control.ss([[-3.0]], [[2.0]], [[1.0]], 0))
    >>> plant.A.tolist(), plant.B.tolist()
    ([[-3.0]], [2.0])
    """
    a, b, c, d = (np.asarray(x, float) for x in (system.A, system.B, system.C, system.D))
    if system.dt not in (0, None):
        raise ArgumentError(f"has a sample time of {system.dt} s; expected a continuous-time plant", "system")
    w = {}
    for name, weights, count in (("direction", direction, b.shape[1]), ("measured", measured, c.shape[0])):
        w[name] = np.ones(1) if weights is None and count == 1 else np.asarray(weights, float)
        if w[name].shape != (count,) or not np.all(np.isfinite(w[name])):
            raise ArgumentError(f"expected {count} finite numbers; found {weights!r}", name)
    if np.any(w["measured"] @ d @ w["direction"] != 0):
        raise ArgumentError("has direct feedthrough to the measured deviation; model the plant's lag", "system")
    return CorrectedPlant(a, b @ w["direction"], w["measured"] @ c)
