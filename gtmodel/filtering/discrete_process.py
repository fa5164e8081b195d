"""A process written by hand, as its step from one instant to the next, or by its matrices."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ..results.refusal import ArgumentError
from .manifold import Manifold, StatePart
from .process import ProcessEquations, covariance_matrix, only_named


class DiscreteProcess:
    """A process written as its step from one instant to the next, with a covariance per step.

    Args:
        states: its states as `StatePart`s.
        period: of the steps [s]; measurements come at multiples of it.
        step: (x), (x, u) or (x, u, t) -> mapping name -> next value; x has the states as attributes, u the known
            inputs, CasADi columns at the begin of the step, t is its time [s].
        covariance: of the noise that each step adds, (n,) for a diagonal or (n, n), in errors of the states; as a noise
            that `tune` and a search of faults may change it is "step".
        outputs: name -> function of the same arguments that gives what a sensor may measure; the states themselves are
            there by name.
        inputs: name -> how many numbers each known input has; `run` takes them as a trajectory.

    Raises ArgumentError for a step that gives no mapping of the next states, or values of other sizes.

    >>> P = gt.filtering.StatePart
    >>> step = lambda x, u: {"x": x.x + 0.1 * x.v, "v": x.v + 0.1 * u.a}
    >>> parts = [P("x", unit="m"), P("v", unit="m/s")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, step, [0.0, 1e-4], inputs={"a": 1})
    >>> process.period, process.noise["step"].shape
    (0.1, (2, 2))
    """

    def __init__(
        self,
        states: Sequence[StatePart],
        period: float,
        step: Callable[..., Mapping[str, Any]],
        covariance: Any,
        outputs: Mapping[str, Callable[..., Any]] | None = None,
        inputs: Mapping[str, int] | None = None,
    ) -> None:
        self.space, self.period, self._step = Manifold(states), float(period), step
        self._outputs = dict(outputs or {})
        self.inputs = dict(inputs or {})
        if not self.period > 0:
            raise ArgumentError(f"expected more than 0 s; found {period}", "period")
        for name, size in self.inputs.items():
            if isinstance(size, bool) or not isinstance(size, int) or size < 1:
                raise ArgumentError(f"expected how many numbers '{name}' has; found {size!r}", "inputs")
        for argument, function in [("step", step), *((f"outputs.{n}", f) for n, f in self._outputs.items())]:
            _takes(function, argument)
        self.noise: dict[str, Any] = {"step": self._covariance(covariance)}

    def _covariance(self, given: Any) -> np.ndarray:
        n = self.space.dimension
        Q = np.diag(given) if np.ndim(given) == 1 else given
        return covariance_matrix(Q, n, "covariance", singular=True)

    @property
    def covariance(self) -> np.ndarray:
        """Of the noise of a step (n, n)."""
        return self.noise["step"]

    def with_noise(self, **noise: Any) -> DiscreteProcess:
        """The same process with another covariance `step`. Raises ArgumentError for a noise of another name."""
        only_named(noise, self.noise, "noise")
        made = copy(self)
        made.noise = {name: self._covariance(value) for name, value in {**self.noise, **noise}.items()}
        return made

    def intensity(self, sizes: Mapping[str, int]) -> np.ndarray:
        """Covariance per step (n, n)."""
        return self.covariance

    def unit_of(self, name: str) -> str:
        """Unit of what may be measured, "?" where none was declared."""
        return next((part.unit for part in self.space.parts if part.name == name), "?")

    def dynamics(self, signals: Sequence[str]) -> ProcessEquations:
        """Its step and these outputs as functions of columns."""
        space = self.space
        names = [part.name for part in space.parts]
        outputs = {}
        for name in signals:
            if name not in names and name not in self._outputs:
                there = ", ".join(f"'{n}'" for n in [*names, *self._outputs])
                raise ArgumentError(f"there is no '{name}' to measure; there are {there}", "sensors")

            def value(t: Any, x: Any, u: Any, p: Any, name: str = name) -> Any:
                if name not in self._outputs:
                    return getattr(self._state(x), name)
                return _column(self._of(f"outputs.{name}", t, x, u), None, f"outputs.{name}")

            outputs[name] = value

        def rates(t: Any, x: Any, u: Any, w: Any, p: Any) -> Any:
            after = self._of("step", t, x, u)
            if not isinstance(after, Mapping):
                given = ", ".join(f"'{n}': ..." for n in names)
                raise ArgumentError(f"expected a mapping {{{given}}}; found a {type(after).__name__}", "step")
            only_named(after, names, "step")
            missing = [n for n in names if n not in after]
            if missing:
                raise ArgumentError(f"it gives no next value of '{missing[0]}'; give one for each state", "step")
            return ca.vertcat(*[_column(after[part.name], part.size, "step", part.name) for part in space.parts])

        return ProcessEquations(space, self.inputs, {}, rates, outputs, self.covariance, {}, period=self.period)

    def _state(self, x: Any) -> SimpleNamespace:
        return SimpleNamespace(**{part.name: x[at] for part, at, _ in self.space.places()})

    def _of(self, argument: str, t: Any, x: Any, u: Any) -> Any:
        """What the step or an output gives. Raises ArgumentError for names that are not there, and for an `if`."""
        function = self._step if argument == "step" else self._outputs[argument.removeprefix("outputs.")]
        given, first = SimpleNamespace(), 0
        for name, size in self.inputs.items():
            setattr(given, name, u[first : first + size])
            first += size
        state = self._state(x)
        try:
            return function(*(state, given, t)[: _takes(function, argument)])
        except AttributeError as error:
            if error.obj is not state and error.obj is not given:
                raise
            there = ", ".join(vars(error.obj)) or "none"
            kind = "state" if error.obj is state else "known input"
            raise ArgumentError(f"reads '{error.name}', which is no {kind}; there are {there}", argument) from error
        except RuntimeError as error:
            if "truth value" not in str(error):
                raise
            raise ArgumentError(
                "decides by a state or an input, which are symbols here; write casadi.if_else(condition, then, "
                "otherwise) in place of an if",
                argument,
            ) from error


def _takes(function: Callable[..., Any], argument: str) -> int:
    """How many of x, u, t a function takes. Raises ArgumentError for one that takes none or more."""
    if not callable(function):
        raise ArgumentError(f"expected a function of x; found {function!r}", argument)
    try:
        kinds = [(p.kind, p.default) for p in inspect.signature(function).parameters.values()]
    except ValueError:  # written in C: it says itself what it takes
        return 1
    plain = [d for k, d in kinds if k in (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)]
    needed = [d for d in plain if d is inspect.Parameter.empty]
    if any(k is inspect.Parameter.VAR_POSITIONAL for k, _ in kinds) and not plain:
        return 3
    if not 1 <= len(needed or plain) <= 3:
        raise ArgumentError(f"expected a function of (x), (x, u) or (x, u, t); it takes {len(needed)}", argument)
    return len(needed or plain[:1])


def _column(value: Any, size: int | None, argument: str, name: str = "") -> Any:
    """A value as a CasADi column. Raises ArgumentError for one of another size, and for what is no numbers."""
    try:
        parts = [*value] if isinstance(value, (list, tuple)) else list(value) if isinstance(value, np.ndarray) else None
        column = ca.vec(ca.vertcat(*parts) if parts else ca.vertcat(value))
    except (NotImplementedError, TypeError, ValueError):
        said = f"expected numbers or expressions of the states{f' for {name!r}' if name else ''}; found {value!r}"
        raise ArgumentError(said, argument) from None
    if size is not None and column.numel() != size:
        raise ArgumentError(f"expected {size} numbers for '{name}'; found {column.numel()}", argument)
    return column


class LinearProcess:
    """A linear process by its matrices, as papers and `control.StateSpace` have it, measured as "y".

    x' = A x + B u + w and y = C x + D u in continuous time, or of the next x where there is a period. The covariance of
    the readings stands at the sensor: `Sensor("y", covariance=R)`.

    Args:
        A: (n, n). C: (p, n).
        Q: covariance of w (n, n), per step, or per second in continuous time; (n,) for a diagonal. As a noise that
            `tune` may change it is "w".
        B, D: of the known inputs "u", (n, m) and (p, m); none if left out.
        period: of the steps [s]; continuous time if left out.

    The states are "x", n numbers. Raises ArgumentError for matrices whose shapes do not fit.

    >>> A, C = [[1.0, 0.1], [0.0, 1.0]], [[1.0, 0.0]]
    >>> process = gt.filtering.LinearProcess(A, C, [0.0, 1e-4], period=0.1)
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("y", covariance=[[0.01]])])
    >>> system.linear, system.space.labels
    (True, ('x[0]', 'x[1]'))
    """

    def __init__(self, A: Any, C: Any, Q: Any, *, B: Any = None, D: Any = None, period: float | None = None) -> None:
        self.A, self.C = (_matrix(value, name) for value, name in ((A, "A"), (C, "C")))
        n, p = len(self.A), len(self.C)
        self.B = np.zeros((n, 0)) if B is None else _matrix(B, "B")
        m = self.B.shape[1]
        self.D = np.zeros((p, m)) if D is None else _matrix(D, "D")
        for name, value, shape in (("A", self.A, (n, n)), ("C", self.C, (p, n)), ("B", self.B, (n, m)),
                                   ("D", self.D, (p, m))):  # fmt: skip
            if value.shape != shape:
                raise ArgumentError(f"expected the shape {shape}; found {value.shape}", name)
        if period is not None and not period > 0:
            raise ArgumentError(f"expected more than 0 s; found {period}", "period")
        self.period = period
        self.noise: dict[str, Any] = {"w": self._covariance(Q)}

    @classmethod
    def of(cls, plant: Any, Q: Any) -> LinearProcess:
        """The process of a `control.StateSpace`, or of anything that has A, B, C, D and dt; all inputs are known.

        Raises ArgumentError for a plant without them, and for a discrete one whose period is not stated.
        """
        missing = [name for name in "ABCD" if not hasattr(plant, name)]
        if missing:
            sentence = f"expected a state space with A, B, C and D; {type(plant).__name__} has no {missing[0]}"
            raise ArgumentError(sentence, "plant")
        dt = getattr(plant, "dt", None)
        if dt is True:
            raise ArgumentError("the plant is discrete, of a period that it does not state; give it a dt in s", "plant")
        own = [np.asarray(getattr(plant, name), float) for name in "ABCD"]
        return cls(own[0], own[2], Q, B=own[1] if own[1].size else None, D=own[3] if own[1].size else None,
                   period=float(dt) if dt else None)  # fmt: skip

    def _covariance(self, Q: Any) -> np.ndarray:
        return covariance_matrix(np.diag(Q) if np.ndim(Q) == 1 else Q, len(self.A), "Q", singular=True)

    def with_noise(self, **noise: Any) -> LinearProcess:
        """The same process with another covariance `w`. Raises ArgumentError for a noise of another name."""
        only_named(noise, self.noise, "noise")
        return LinearProcess(self.A, self.C, noise.get("w", self.noise["w"]), B=self.B, D=self.D, period=self.period)

    def intensity(self, sizes: Mapping[str, int]) -> np.ndarray:
        """Covariance of the noise (n, n), per second or per step."""
        return self.noise["w"]

    def unit_of(self, name: str) -> str:
        """Not stated by matrices: "?"."""
        return "?"

    def dynamics(self, signals: Sequence[str]) -> ProcessEquations:
        """Its equations as functions of columns."""
        wrong = [name for name in signals if name not in ("x", "y")]
        if wrong:
            raise ArgumentError(f"there is no '{wrong[0]}' to measure; there are 'y' and 'x'", "sensors")
        A, B, C, D = (ca.sparsify(ca.DM(M)) for M in (self.A, self.B, self.C, self.D))
        n, m = self.B.shape
        continuous = self.period is None

        def rates(t: Any, x: Any, u: Any, w: Any, p: Any) -> Any:
            after = ca.mtimes(A, x) + (ca.mtimes(B, u) if m else 0)
            return after + w if continuous else after

        def output(t: Any, x: Any, u: Any, p: Any) -> Any:
            return ca.mtimes(C, x) + (ca.mtimes(D, u) if m else 0)

        outputs = {"y": output, "x": lambda t, x, u, p: x}
        space = Manifold([StatePart("x", size=n, unit="?")])
        return ProcessEquations(
            space, {"u": m} if m else {}, {"w": n} if continuous else {}, rates,
            {name: outputs[name] for name in signals}, self.noise["w"], {}, period=self.period,
        )  # fmt: skip


def _matrix(value: Any, name: str) -> np.ndarray:
    try:
        M = np.atleast_2d(np.asarray(value, float))
    except (TypeError, ValueError):
        raise ArgumentError(f"expected a matrix of numbers; found {value!r}", name) from None
    if M.ndim != 2 or not np.isfinite(M).all():
        raise ArgumentError(f"expected a matrix of finite numbers; found {value!r}", name)
    return M
