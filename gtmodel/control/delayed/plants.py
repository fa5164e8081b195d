"""What a late correction acts on: the equivalent-force oscillator, a rigid arm, or any linearised model."""

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

MOST_CYCLES = 2000  # of delay: the companion matrix of a loop has a state for each


@dataclass(frozen=True, eq=False)
class CorrectedPlant:
    """x' = A x + B u, y = C x: u is the correction of one cycle, held over it, y the deviation that is measured.

    A (n, n), B (n,), C (n,). Both u and y in m where the plant is an arm. Raises ArgumentError for other shapes and for
    what is not finite.

    >>> plant = gt.control.delayed.rigid_plant(cycle=0.004)
    >>> plant.A.shape, plant.B  # in one cycle it moves by the correction
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
            raise ArgumentError("A, B and C hold a number that is not finite")
        for name, value in (("A", a), ("B", b), ("C", c)):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.A)


def equivalent_plant(m: float, c: float, k: float, cycle: float, *, accumulate: bool = False) -> CorrectedPlant:
    """m x'' + c x' + k x = u / cycle^2 for a correction u [m] of one cycle [s] (Cvitanic 2021, eq. (30)).

    m [1], c [1/s] and k [1/s2] are equivalent ones: the force is an acceleration, so that a mass of one is moved by u/2
    in the cycle. `accumulate`: the correction also moves the arm itself by u, at constant speed over the cycle, and it
    stays; else only its vibration is left, as the thesis simulates it. Raises ArgumentError for what is not positive; c
    may be 0.

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
    """An arm without vibration that moves by each correction, at constant speed over the cycle [s], and stays there.

    Raises ArgumentError for a cycle that is not positive.

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
    """One plant of several: each takes its share `into` of the correction and adds its share `out_of` of the deviation.

    Along a direction with shares s, c of two axes both are (s, c), and the plant is s^2 G_x + c^2 G_y. Raises
    ArgumentError where the numbers of plants and shares differ.

    >>> soft, stiff = (gt.control.delayed.equivalent_plant(m, 40.0 * m, 1.2e4 * m, 0.004) for m in (0.3, 4.0))
    >>> s = np.sqrt(0.5)
    >>> len(gt.control.delayed.side_by_side([stiff, soft], [s, s], [s, s]))  # states
    4
    """
    if not len(plants) == len(into) == len(out_of) or not plants:
        raise ArgumentError(f"{len(plants)} plants need as many shares; found {len(into)} and {len(out_of)}")
    size = sum(len(p) for p in plants)
    a, at = np.zeros((size, size)), 0
    for p in plants:
        a[at : at + len(p), at : at + len(p)] = p.A
        at += len(p)
    b = np.concatenate([share * p.B for p, share in zip(plants, into, strict=True)])
    c = np.concatenate([share * p.C for p, share in zip(plants, out_of, strict=True)])
    return CorrectedPlant(a, b, c)


def linear_plant(system: StateSpace, direction: Any = None, measured: Any = None) -> CorrectedPlant:
    """The plant of a linear model in continuous time, such as `gt.linearize` gives.

    Args:
        system: from corrections to positions.
        direction: (inputs,) what a correction of one adds to each input; 1 where there is one input.
        measured: (outputs,) weights of the outputs in the deviation; 1 where there is one output.

    Raises ArgumentError for a model at samples, for one whose input acts at once (D), and for other shapes.

    >>> import control
    >>> plant = gt.control.delayed.linear_plant(control.ss([[-3.0]], [[2.0]], [[1.0]], 0))
    >>> plant.A.tolist(), plant.B.tolist()
    ([[-3.0]], [2.0])
    """
    a, b, c, d = (np.asarray(x, float) for x in (system.A, system.B, system.C, system.D))
    if system.dt not in (0, None):
        raise ArgumentError(f"has a sample time of {system.dt} s; give the plant in continuous time", "system")
    w = {}
    for name, given, count in (("direction", direction, b.shape[1]), ("measured", measured, c.shape[0])):
        w[name] = np.ones(1) if given is None and count == 1 else np.asarray(given, float)
        if w[name].shape != (count,) or not np.all(np.isfinite(w[name])):
            raise ArgumentError(f"expected {count} finite numbers; found {given!r}", name)
    if np.any(w["measured"] @ d @ w["direction"] != 0):
        raise ArgumentError("the correction acts on the measured deviation at once; model the plant's lag", "system")
    return CorrectedPlant(a, b @ w["direction"], w["measured"] @ c)
