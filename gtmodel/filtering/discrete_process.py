"""A process given as its step from one instant to the next, or by its matrices."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..results.refusal import ArgumentError
from .manifold import Manifold, StatePart
from .process import ProcessEquations, covariance_matrix, only_named


class DiscreteProcess(Portable):
    """A process given as its step from one instant to the next, with a covariance per step.

    Args:
        states: its states as `StatePart`s.
        period: of the steps [s]; measurements are sampled at its multiples.
        step: (x), (x, u) or (x, u, t) -> mapping name -> next value; x has the states as attributes and u the known
            inputs, CasADi columns at the start of the step; t is the time there [s].
        covariance: of the noise that each step adds, (n,) for a diagonal or (n, n), in errors of the states. Its name
            as a noise is "step", for `tune` and `find_faults`.
        outputs: name -> function of the same arguments that returns a measurable quantity; every state is measurable
            by its name.
        inputs: name -> size of each known input; `run` takes them as a trajectory.

    Raises ArgumentError if the step does not return a mapping of all next states, or returns values of wrong size.

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
                raise ArgumentError(f"expected the size of '{name}', at least 1; found {size!r}", "inputs")
        for argument, function in [("step", step), *((f"outputs.{n}", f) for n, f in self._outputs.items())]:
            _takes(function, argument)
        self.noise: dict[str, Any] = {"step": self._covariance(covariance)}

    def _covariance(self, value: Any) -> np.ndarray:
        n = self.space.dimension
        Q = np.diag(value) if np.ndim(value) == 1 else value
        return covariance_matrix(Q, n, "covariance", singular=True)

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the noise of a step (n, n)."""
        return self.noise["step"]

    def with_noise(self, **noise: Any) -> DiscreteProcess:
        """Return the same process with another covariance `step`. Raises ArgumentError for a noise of another name."""
        only_named(noise, self.noise, "noise")
        other = copy(self)
        other.noise = {name: self._covariance(value) for name, value in {**self.noise, **noise}.items()}
        return other

    def intensity(self, sizes: Mapping[str, int]) -> np.ndarray:
        """Covariance per step (n, n)."""
        return self.covariance

    def unit_of(self, name: str) -> str:
        """Unit of a measurable quantity, "?" if none was declared."""
        return next((part.unit for part in self.space.parts if part.name == name), "?")

    def dynamics(self, signals: Sequence[str]) -> ProcessEquations:
        """Return the step and these outputs as functions of CasADi columns."""
        space = self.space
        names = [part.name for part in space.parts]
        outputs = {}
        for name in signals:
            if name not in names and name not in self._outputs:
                measurable = ", ".join(f"'{n}'" for n in [*names, *self._outputs])
                raise ArgumentError(f"there is no '{name}' to measure; expected one of {measurable}", "sensors")

            def value(t: Any, x: Any, u: Any, p: Any, name: str = name) -> Any:
                if name not in self._outputs:
                    return getattr(self._state(x), name)
                return _column(self._of(f"outputs.{name}", t, x, u), None, f"outputs.{name}")

            outputs[name] = value

        def rates(t: Any, x: Any, u: Any, w: Any, p: Any) -> Any:
            after = self._of("step", t, x, u)
            if not isinstance(after, Mapping):
                entries = ", ".join(f"'{n}': ..." for n in names)
                raise ArgumentError(f"expected a mapping {{{entries}}}; found a {type(after).__name__}", "step")
            only_named(after, names, "step")
            missing = [n for n in names if n not in after]
            if missing:
                raise ArgumentError(f"it returns no next value of '{missing[0]}'; return one for each state", "step")
            return ca.vertcat(*[_column(after[part.name], part.size, "step", part.name) for part in space.parts])

        return ProcessEquations(space, self.inputs, {}, rates, outputs, self.covariance, {}, period=self.period)

    def _state(self, x: Any) -> SimpleNamespace:
        return SimpleNamespace(**{part.name: x[at] for part, at, _ in self.space.places()})

    def _of(self, argument: str, t: Any, x: Any, u: Any) -> Any:
        """Value of the step or of an output. Raises ArgumentError for unknown names, and for an `if` on symbols."""
        function = self._step if argument == "step" else self._outputs[argument.removeprefix("outputs.")]
        known, first = SimpleNamespace(), 0
        for name, size in self.inputs.items():
            setattr(known, name, u[first : first + size])
            first += size
        state = self._state(x)
        try:
            return function(*(state, known, t)[: _takes(function, argument)])
        except AttributeError as error:
            if error.obj is not state and error.obj is not known:
                raise
            names = ", ".join(vars(error.obj)) or "none"
            kind = "state" if error.obj is state else "known input"
            raise ArgumentError(f"there is no {kind} '{error.name}'; the {kind}s are {names}", argument) from error
        except RuntimeError as error:
            if "truth value" not in str(error):
                raise
            raise ArgumentError(
                "branches on a state or an input, which are symbols here; write casadi.if_else(condition, then, "
                "otherwise) in place of an if",
                argument,
            ) from error


def _takes(function: Callable[..., Any], argument: str) -> int:
    """How many of x, u, t a function takes. Raises ArgumentError unless it takes 1 to 3 arguments."""
    if not callable(function):
        raise ArgumentError(f"expected a function of x; found {function!r}", argument)
    try:
        kinds = [(p.kind, p.default) for p in inspect.signature(function).parameters.values()]
    except ValueError:  # written in C, without a signature
        return 1
    plain = [d for k, d in kinds if k in (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)]
    needed = [d for d in plain if d is inspect.Parameter.empty]
    if any(k is inspect.Parameter.VAR_POSITIONAL for k, _ in kinds) and not plain:
        return 3
    if not 1 <= len(needed or plain) <= 3:
        raise ArgumentError(f"expected a function of (x), (x, u) or (x, u, t); it takes {len(needed)}", argument)
    return len(needed or plain[:1])


def _column(value: Any, size: int | None, argument: str, name: str = "") -> Any:
    """A value as a CasADi column. Raises ArgumentError for a wrong size, and for anything that is not numeric."""
    try:
        parts = [*value] if isinstance(value, (list, tuple)) else list(value) if isinstance(value, np.ndarray) else None
        column = ca.vec(ca.vertcat(*parts) if parts else ca.vertcat(value))
    except (NotImplementedError, TypeError, ValueError):
        sentence = f"expected numbers or expressions of the states{f' for {name!r}' if name else ''}; found {value!r}"
        raise ArgumentError(sentence, argument) from None
    if size is not None and column.numel() != size:
        raise ArgumentError(f"expected {size} numbers for '{name}'; found {column.numel()}", argument)
    return column


class LinearProcess:
    """A linear process by its matrices, as in papers and `control.StateSpace`; its output is "y".

    x' = A x + B u + w and y = C x + D u in continuous time; with a period, the first equation gives the next x. The
    covariance of the readings belongs to the sensor: `Sensor("y", covariance=R)`.

    Args:
        A: (n, n). C: (p, n).
        Q: covariance of w (n, n), per step, or per second in continuous time; (n,) for a diagonal. Its name as a noise
            is "w", for `tune`.
        B, D: of the known inputs "u", (n, m) and (p, m); no inputs if left out.
        period: of the steps [s]; continuous time if left out.

    The state is "x", n numbers. Raises ArgumentError for matrices whose shapes do not match.

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
        """Make the process from a `control.StateSpace` or any object with A, B, C, D and dt; all inputs are known.

        Raises ArgumentError if the object lacks one of them, or if a discrete plant does not state its period.
        """
        missing = [name for name in "ABCD" if not hasattr(plant, name)]
        if missing:
            sentence = f"expected a state space with A, B, C and D; {type(plant).__name__} has no {missing[0]}"
            raise ArgumentError(sentence, "plant")
        dt = getattr(plant, "dt", None)
        if dt is True:
            raise ArgumentError("the plant is discrete but does not state its period; give it a dt in s", "plant")
        A, B, C, D = (np.asarray(getattr(plant, name), float) for name in "ABCD")
        return cls(A, C, Q, B=B if B.size else None, D=D if B.size else None, period=float(dt) if dt else None)

    def _covariance(self, Q: Any) -> np.ndarray:
        return covariance_matrix(np.diag(Q) if np.ndim(Q) == 1 else Q, len(self.A), "Q", singular=True)

    def with_noise(self, **noise: Any) -> LinearProcess:
        """Return the same process with another covariance `w`. Raises ArgumentError for a noise of another name."""
        only_named(noise, self.noise, "noise")
        return LinearProcess(self.A, self.C, noise.get("w", self.noise["w"]), B=self.B, D=self.D, period=self.period)

    def intensity(self, sizes: Mapping[str, int]) -> np.ndarray:
        """Covariance of the noise (n, n), per second or per step."""
        return self.noise["w"]

    def unit_of(self, name: str) -> str:
        """Always "?": matrices state no units."""
        return "?"

    def dynamics(self, signals: Sequence[str]) -> ProcessEquations:
        """Return its equations as functions of CasADi columns."""
        wrong = [name for name in signals if name not in ("x", "y")]
        if wrong:
            raise ArgumentError(f"there is no '{wrong[0]}' to measure; expected 'y' or 'x'", "sensors")
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
