"""Plants of learning control: stable discrete-time linear systems with one input and one output."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..._lazy import hint
from ...linear.response import Transfer
from ...results import ArgumentError
from .references import ACTUATOR_DELAY as ACTUATOR_DELAY, ACTUATORS as ACTUATORS, SAMPLE_TIME as SAMPLE_TIME

if TYPE_CHECKING:
    from control import StateSpace, TransferFunction
else:
    StateSpace, TransferFunction = hint("control", "StateSpace"), hint("control", "TransferFunction")


class SampledSystem:
    """A discrete-time linear system x(k+1) = A x + B u, y = C x + D u with the sample time dt [s].

    The plants of this package. They have the attributes of `control.StateSpace` that are used here, without the import
    of python-control, which takes longer than many designs; `to_control` returns one of its systems.

    >>> system = gt.control.learning.SampledSystem([[0.5]], [[1.0]], [[0.25]], [[0.5]], 0.004)
    >>> system.nstates, system.poles().tolist(), float(system.to_control().dcgain())
    (1, [0.5], 1.0)
    """

    def __init__(self, A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, dt: float) -> None:
        self.A, self.B, self.C, self.D = (np.array(m, float, ndmin=2) for m in (A, B, C, D))
        self.dt = dt

    @property
    def nstates(self) -> int:
        """Number of states."""
        return len(self.A)

    @property
    def ninputs(self) -> int:
        """Number of inputs."""
        return self.B.shape[1]

    @property
    def noutputs(self) -> int:
        """Number of outputs."""
        return len(self.C)

    def isdtime(self, strict: bool = False) -> bool:
        """Return True: the system is sampled."""
        return True

    def poles(self) -> np.ndarray:
        """Return the poles (n,), the eigenvalues of A."""
        return np.linalg.eigvals(self.A)

    def to_control(self) -> StateSpace:
        """Return the system as a control.StateSpace."""
        from ..._control import control

        return control.StateSpace(self.A, self.B, self.C, self.D, self.dt)


Plant = SampledSystem | StateSpace | TransferFunction


def delayed_lag(b: float, a: float, delay: int, sample_time: float = SAMPLE_TIME) -> SampledSystem:
    """Return b q^-delay / (1 - a q^-1), a controlled actuator: Dressler 2012, (6.10) and (6.11).

    delay: in samples; raises ArgumentError if it is negative. sample_time: [s].

    >>> learning = gt.control.learning
    >>> loop = learning.delayed_lag(*learning.ACTUATORS[0], learning.ACTUATOR_DELAY)
    >>> learning.pulse_response(loop, 7).round(5).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.03527, 0.03402]
    """
    if delay < 0:
        raise ArgumentError(f"must not be negative; found {delay} samples", "delay")
    if delay == 0:
        return SampledSystem([[a]], [[1.0]], [[b * a]], [[b]], sample_time)
    A = np.diag(np.ones(delay - 1), -1) if delay > 1 else np.zeros((1, 1))
    A[0, 0] = a
    B, C = np.zeros((delay, 1)), np.zeros((1, delay))
    B[0, 0], C[0, -1] = 1.0, b
    return SampledSystem(A, B, C, [[0.0]], sample_time)


def discrete(plant: Plant) -> SampledSystem | StateSpace:
    """Return the plant in state-space form. Raises ArgumentError for several inputs or outputs, or continuous time."""
    if not isinstance(plant, SampledSystem):
        from ..._control import control

        if not isinstance(plant, (control.StateSpace, control.TransferFunction)):
            raise ArgumentError(
                "expected a SampledSystem, control.StateSpace or control.TransferFunction; found "
                f"{type(plant).__name__}", "plant",
            )  # fmt: skip
    if (plant.ninputs, plant.noutputs) != (1, 1):
        raise ArgumentError(f"expected one input and one output; found {plant.ninputs} and {plant.noutputs}", "plant")
    if not plant.isdtime(strict=True):
        raise ArgumentError("the plant is in continuous time; sample it with control.c2d(plant, period)", "plant")
    if isinstance(plant, SampledSystem):
        return plant
    from ..._control import control

    system = plant if isinstance(plant, control.StateSpace) else control.ss(plant)
    assert isinstance(system, control.StateSpace)
    return system


def stable(plant: Plant, below: float = 1.0) -> SampledSystem | StateSpace:
    """Return the plant in state-space form. Raises ArgumentError for a pole with a modulus of `below` or more.

    The lifted map of an unstable plant grows with the length of the run; learning control requires a stabilised loop
    (Dressler 2012, (7.1)).

    >>> learning = gt.control.learning
    >>> try:
    ...     learning.stable(learning.delayed_lag(1.0, 1.02, delay=1))
    ... except gt.results.ArgumentError as error:
    ...     print(error.argument)
    plant
    """
    system = discrete(plant)
    radius = float(np.max(np.abs(system.poles()), initial=0.0))
    if radius >= below:
        raise ArgumentError(
            f"the plant has a pole of modulus {radius:.6g}, so its lifted map grows with the length of the run; "
            "stabilise it first",
            "plant",
        )
    return system


def pulse_response(plant: Plant, size: int) -> np.ndarray:
    """Return the response (size,) to 1, 0, 0, ... from rest. Raises ArgumentError as `discrete`.

    >>> learning = gt.control.learning
    >>> learning.pulse_response(learning.delayed_lag(0.5, 0.5, delay=1), 4).tolist()
    [0.0, 0.5, 0.25, 0.125]
    """
    p = discrete(plant)
    A, B, C, D = (np.asarray(m, float) for m in (p.A, p.B, p.C, p.D))
    response = np.zeros(size)
    response[:1] = D[0, 0]
    # C A^k B in blocks: the powers A^0 to A^(m-1) once, then steps of m
    if len(A) and size > 1:
        block = max(1, int(np.sqrt(size)))
        rows = [C[0]]
        for _ in range(block - 1):
            rows.append(rows[-1] @ A)
        observed, jump, x = np.array(rows), np.linalg.matrix_power(A, block), B[:, 0]
        for k in range(1, size, block):
            part = observed @ x
            response[k : k + block] = part[: size - k]
            x = jump @ x
    return response


def frequency_response(plant: Plant, frequency: np.ndarray) -> np.ndarray:
    """Return G(e^jw) (k,) at frequencies (k,) in Hz. Raises ArgumentError as `discrete`.

    >>> learning = gt.control.learning
    >>> loop = learning.delayed_lag(0.5, 0.5, delay=1)
    >>> abs(learning.frequency_response(loop, np.array([0.0]))).round(12)  # static gain b / (1 - a)
    array([1.])
    """
    p = discrete(plant)
    A, B, C, D = (np.asarray(m, float) for m in (p.A, p.B, p.C, p.D))
    z = np.exp(2j * np.pi * np.asarray(frequency, float) * float(p.dt or 1.0))
    return Transfer(A, B, C[0]).at(z, [1.0]) + D[0, 0]
