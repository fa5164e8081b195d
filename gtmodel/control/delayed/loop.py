"""A sampled loop with delay: companion matrix, frequency response, and the frequency grid."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from gtmodel.simulation.hybrid.clock import exact

from ..._lazy import hint
from ...linear.response import Transfer
from ...linear.state_space import continuous_poles, held, held_late
from ...results import ArgumentError
from .plants import MOST_CYCLES, CorrectedPlant

if TYPE_CHECKING:
    from control import StateSpace
else:
    StateSpace = hint("control", "StateSpace")

EVEN = 1200  # equally spaced frequencies up to the Nyquist frequency
LOW = 200  # logarithmically spaced frequencies towards zero; a quarter as many towards the Nyquist frequency
LOWEST = 1e-6  # of the Nyquist frequency or the slowest pole
SHARES = np.linspace(0, 1, LOW)  # of the logarithm from the lowest to the Nyquist frequency
NEAR_TOP = 1 - np.geomspace(LOWEST, 0.1, LOW // 4)  # of the Nyquist frequency
TURN = 24  # frequencies on each side of a resonance, at equal steps of phase
TURNS = np.tan(np.pi / 2 * np.linspace(-1, 1, 2 * TURN + 1)[1:-1])
TAIL = 12  # frequencies per decade of distance from a resonance
NARROW = 1e-10  # of the Nyquist frequency: least width of a resonance
ON_A_POLE = 1e-13  # frequencies this close to a pole are left out
APART = 0.25  # largest relative change of the response between neighbouring frequencies
ROUNDS = 12  # of bisection
WIDTH = 1e-12  # relative tolerance of a frequency at which the phase turns back


def frequencies(loop: DelayedLoop) -> np.ndarray:
    """Return angular frequencies (w,) [rad/s] up to the Nyquist frequency, dense where the phase changes fast."""
    top = np.pi / loop.cycle
    z = np.concatenate(loop.poles)
    poles = continuous_poles(z[np.abs(z) > 1e-12], loop.cycle)
    slow = np.abs(poles[np.abs(poles) > WIDTH * top])
    low = LOWEST * min(top, float(slow.min(initial=top)))
    even = max(EVEN, 40 * (loop.split[0] + 2))
    grids = [np.linspace(0, top, even + 1)[1:], low * (top / low) ** SHARES, top * NEAR_TOP]
    for pole in poles[poles.imag > 0].tolist():
        wide = max(abs(pole.real), NARROW * top)
        far = max(20.0, top / wide)
        last = 1 + int(TAIL * math.log10(far))
        tails = 10 * wide * (far / 10) ** (np.arange(last + 1) / last)
        grids += [pole.imag + wide * TURNS, pole.imag + tails, pole.imag - tails]
    w = np.unique(np.concatenate(grids))
    return off_poles(loop, w[(w >= low) & (w <= top)])


def sampled_response(loop: DelayedLoop) -> tuple[np.ndarray, np.ndarray]:
    """Return angular frequencies (w,) [rad/s], bisected where the response changes much, and the response (w,)."""
    w = frequencies(loop)
    g = loop.response(w)
    for _ in range(ROUNDS):
        size = np.abs(g)
        far = np.flatnonzero(np.abs(np.diff(g)) > APART * np.minimum(size[:-1], size[1:]))
        between = (w[far] + w[far + 1]) / 2
        between = off_poles(loop, between[(between > w[far]) & (between < w[far + 1])])
        if not len(between):
            break
        w, g = np.concatenate([w, between]), np.concatenate([g, loop.response(between)])
        order = np.argsort(w, kind="stable")
        w, g = w[order], g[order]
    return w, g


def off_poles(loop: DelayedLoop, w: np.ndarray) -> np.ndarray:
    """Return the frequencies (w,) at which the response is finite."""
    near = [z for poles in loop.poles for z in poles.tolist() if abs(abs(z) - 1) <= 2 * ON_A_POLE]
    if not near:
        return w
    return w[np.abs(np.exp(1j * w * loop.cycle)[:, None] - near).min(axis=1) > ON_A_POLE]


@dataclass(frozen=True, eq=False)
class DelayedLoop:
    """A plant whose deviation y is measured every `cycle` [s]; the correction with gain P acts `delay` [s] later.

    u(k) = -P (law of y)(k), held over one cycle from t_k + delay on. If the delay is not a whole number of cycles, the
    hold is split exactly. `law`: one input, one output, sampled with the cycle, for example with integral action; by
    default proportional. Raises ArgumentError if cycle, delay and law do not fit together.

    >>> plant = gt.control.delayed.equivalent_plant(3.0, 57.7, 34200.0, cycle=0.004)
    >>> loop = gt.control.delayed.DelayedLoop(plant, cycle=0.004, delay=0.052)
    >>> loop.matrix(0.2).shape, bool(loop.radius(0.2) < 1 < loop.radius(0.3))  # 2 states, 13 corrections
    ((15, 15), True)
    """

    plant: CorrectedPlant
    cycle: float
    delay: float
    law: StateSpace | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.cycle) and self.cycle > 0):
            raise ArgumentError(f"must be a number above 0; found {self.cycle!r}", "cycle")
        if not (np.isfinite(self.delay) and self.delay >= 0):
            raise ArgumentError(f"must be a number, at least 0; found {self.delay!r}", "delay")
        if self.delay > MOST_CYCLES * self.cycle:
            raise ArgumentError(f"must be at most {MOST_CYCLES} cycles; found {self.delay / self.cycle:.4g}", "delay")
        if self.law is not None and (self.law.ninputs != 1 or self.law.noutputs != 1 or self.law.dt != self.cycle):
            raise ArgumentError(
                f"has {self.law.ninputs} inputs, {self.law.noutputs} outputs and the sample time {self.law.dt}; "
                f"expected one, one and the cycle, {self.cycle:g} s",
                "law",
            )

    def __len__(self) -> int:
        """Number of states of `matrix`."""
        whole, rest = self.split
        return len(self.plant) + len(self.law_matrices[0]) + whole + (rest > 0)

    def late_by(self, seconds: float) -> DelayedLoop:
        """Return the same loop with a delay of `seconds`."""
        return DelayedLoop(self.plant, self.cycle, seconds, self.law)

    @cached_property
    def split(self) -> tuple[int, float]:
        """Whole cycles of the delay and its remainder [s], in exact decimal arithmetic."""
        whole, rest = divmod(exact(self.delay), exact(self.cycle))
        return int(whole), float(rest)

    @cached_property
    def transition(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x(k+1) = A x(k) + early u(k - whole - 1) + late u(k - whole), exact: A (n, n), early (n,), late (n,)."""
        _, rest = self.split
        remainder = float(exact(self.cycle) - exact(rest))
        A, early, late = held_late(self.plant.A, self.plant.B[:, None], rest, remainder)
        return A, early[:, 0], late[:, 0]

    @cached_property
    def law_matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """The law's A (q, q), B (q,), C (q,) and D; q = 0 for a proportional law."""
        if self.law is None:
            return np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
        a, b, c, d = (np.asarray(x, float) for x in (self.law.A, self.law.B, self.law.C, self.law.D))
        return a, b[:, 0], c[0], float(d[0, 0])

    @cached_property
    def _affine(self) -> tuple[np.ndarray, np.ndarray]:
        """The companion matrix without correction, and the contribution of a gain of one; the last column is the effect
        of measurement noise."""
        (whole, rest), (a, early, late), (la, lb, lc, ld) = self.split, self.transition, self.law_matrices
        n, q, m = len(a), len(la), whole + (rest > 0)
        size = n + q + m
        rows = np.zeros((2, size, size + 1))
        correction = np.zeros(size + 1)
        correction[:n], correction[n : n + q], correction[size] = -ld * self.plant.C, -lc, -ld
        rows[0, :n, :n] = a
        rows[0, n : n + q, :n], rows[0, n : n + q, n : n + q] = np.outer(lb, self.plant.C), la
        rows[0, n : n + q, size] = lb
        for age, effect in ((whole, late), (whole + 1, early)):  # samples ago
            if age == 0:
                rows[1, :n] += np.outer(effect, correction)
            elif age <= m:
                rows[0, :n, n + q + age - 1] += effect
        if m:
            rows[1, n + q] = correction
            rows[0, n + q + 1 :, n + q : size - 1] = np.eye(m - 1)
        return rows[0], rows[1]

    def matrix(self, gain: float) -> np.ndarray:
        """Return the companion matrix; states: of the plant, of the law, then pending corrections, newest first.

        Raises ArgumentError if the gain is not finite, as do `radius`, `stable` and `noise_entry`.
        """
        _checked(gain)
        free, added = self._affine
        return free[:, :-1] + gain * added[:, :-1]

    def noise_entry(self, gain: float) -> np.ndarray:
        """Return the effect of unit measurement noise on the states of `matrix` at the next sample, (n,)."""
        _checked(gain)
        free, added = self._affine
        return free[:, -1] + gain * added[:, -1]

    @cached_property
    def steering_entry(self) -> np.ndarray:
        """Effect of a unit command, without delay and held over a cycle, on the states of `matrix`, (n,)."""
        entry = np.zeros(len(self._affine[0]))
        entry[: len(self.plant)] = held(self.plant.A, self.plant.B[:, None], self.cycle)[1][:, 0]
        return entry

    def correction(self, gain: float, state: np.ndarray, noise: Any = 0.0) -> Any:
        """Return u (...) at samples from the states of `matrix` (..., n) and the measurement noise (...)."""
        la, _, lc, ld = self.law_matrices
        n, q = len(self.plant), len(la)
        return -gain * (ld * (state[..., :n] @ self.plant.C + noise) + state[..., n : n + q] @ lc)

    def radius(self, gain: float) -> float:
        """Return the spectral radius of `matrix`; below 1 the loop is stable."""
        return float(np.abs(np.linalg.eigvals(self.matrix(gain))).max())

    def stable(self, gain: float) -> bool:
        """Return whether the loop is stable with this gain."""
        return self.radius(gain) < 1

    def response(self, omega: np.ndarray) -> np.ndarray:
        """Return L (w,) for a gain of one at angular frequencies (w,) [rad/s] up to pi / cycle; y = -P L y in the loop.

        The response from sample to sample is exact, including hold and split delay; infinite on a pole.
        """
        with np.errstate(all="ignore"):
            g = self._at(np.exp(1j * np.asarray(omega, float).reshape(-1) * self.cycle))
        return np.where(np.isfinite(g), g, np.inf)

    def response_at(self, omega: float) -> complex:
        """Return L at one angular frequency [rad/s]; see `response`."""
        try:
            g = complex(self._at(cmath.exp(1j * omega * self.cycle)))
        except ZeroDivisionError:
            return complex(np.inf)
        return g if cmath.isfinite(g) else complex(np.inf)

    @cached_property
    def poles(self) -> tuple[np.ndarray, np.ndarray]:
        """Discrete-time poles of the plant (n,) and of the law (q,), without corrections."""
        return np.linalg.eigvals(self.transition[0]), np.linalg.eigvals(self.law_matrices[0])

    @cached_property
    def sampled(self) -> tuple[np.ndarray, np.ndarray]:
        """Angular frequencies (w,) [rad/s] from `sampled_response`, and the response (w,)."""
        return sampled_response(self)

    @cached_property
    def _transfers(self) -> tuple[Transfer, Transfer | None]:
        (a, early, late), (la, lb, lc, _) = self.transition, self.law_matrices
        plant = Transfer(a, np.stack([early, late], axis=1), self.plant.C)
        return plant, Transfer(la, lb[:, None], lc) if len(la) else None

    def _at(self, z: Any) -> Any:
        plant, law = self._transfers
        g = plant.at(z, [1 / z, 1.0]) / z ** self.split[0]
        through = self.law_matrices[3]
        return g * (through + law.at(z, [1.0]) if law else through)


def _checked(gain: float) -> None:
    if not np.isfinite(gain):
        raise ArgumentError(f"must be a finite number; found {gain!r}", "gain")
