"""What moves, and how uncertain that is: any compiled model with its noise declared as inputs, with a full
covariance where numbers are not independent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import casadi as ca
import numpy as np
from scipy.linalg import block_diag

from .._lazy import hint
from ..compiler.causal import CausalFunction, compile_causal, state_groups
from ..compiler.flat_cache import flat_of
from ..lang.scope import derivative_name
from ..results.refusal import ArgumentError
from .manifold import Manifold, PartKind, StatePart

if TYPE_CHECKING:
    from ..lang.model import Model
else:
    Model = hint("gtmodel.lang.model", "Model")

ROUNDING = 1e-9  # of the largest entry: a covariance that another program computed is symmetric to this
SINGULAR = 1e-12  # of its trace: eigenvalues above minus this are round-off of zero
SAME = 1e-9  # of mixing matrices, which have entries about one


def covariance_matrix(value: Any, size: int, argument: str, *, singular: bool) -> np.ndarray:
    """A covariance (size, size) as it was given. Raises ArgumentError for another shape, one that is not symmetric, and
    one that is not positive definite, or with `singular` not even semidefinite."""
    try:
        R = np.asarray(value, float)
    except (TypeError, ValueError):
        R = np.full(0, np.nan)
    if R.shape != (size, size) or not np.isfinite(R).all():
        shown = f"shape {R.shape}" if R.ndim == 2 and np.isfinite(R).all() else repr(value)
        raise ArgumentError(f"expected a covariance ({size}, {size}) of finite numbers; found {shown}", argument)
    if np.abs(R - R.T).max() > ROUNDING * np.abs(R).max():
        i, j = np.unravel_index(int(np.argmax(np.abs(R - R.T))), R.shape)
        sentence = f"expected a symmetric covariance; found {R[i, j]:g} at [{i}, {j}] and {R[j, i]:g} at [{j}, {i}]"
        raise ArgumentError(sentence, argument)
    d = np.sqrt(np.maximum(np.diag(R), 0.0))
    safe = np.where(d > 0, d, 1.0)
    least = float(np.linalg.eigvalsh(R / np.outer(safe, safe) + np.diag(np.where(d > 0, 0.0, 1.0)))[0])
    wrong_axis = bool(np.any(np.diag(R) < 0) or np.any(R[d == 0] != 0))
    if wrong_axis or least < -SINGULAR * size or (not singular and (np.any(d == 0) or least <= SINGULAR)):
        wanted = "positive semidefinite" if singular else "positive definite"
        raise ArgumentError(
            f"expected a {wanted} covariance; found {'a row without a variance' if wrong_axis else ''}"
            f"{'' if wrong_axis else f'a smallest eigenvalue of {least:.3g} in units of its deviations'}",
            argument,
        )
    return (R + R.T) / 2


def mixing(R: np.ndarray) -> np.ndarray:
    """W with W diag(R) W' = R: what makes noise of covariance R of independent numbers of the same variances.

    >>> W = mixing(np.array([[4.0, 1.0], [1.0, 1.0]]))
    >>> (W @ np.diag([4.0, 1.0]) @ W.T).round(12).tolist()
    [[4.0, 1.0], [1.0, 1.0]]
    """
    d = np.sqrt(np.diag(R))
    safe = np.where(d > 0, d, 1.0)
    unit = R / np.outer(safe, safe) + np.diag(np.where(d > 0, 0.0, 1.0))
    try:
        root = np.linalg.cholesky(unit)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(unit)
        root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T  # whatever signs the vectors have
    return safe[:, None] * root / safe


def independent(R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """L and d with L diag(d)^2 L' = R, L lower triangular with ones on its diagonal: L^-1 times numbers of covariance R
    are independent, of deviations d; the first of them depend on the first numbers alone, and no volume changes.

    >>> L, d = independent(np.array([[4.0, 2.0], [2.0, 5.0]]))
    >>> L.tolist(), d.tolist()
    ([[1.0, 0.0], [0.5, 1.0]], [2.0, 2.0])
    """
    root = np.linalg.cholesky(R)
    d = np.diag(root)
    return root / d, d.copy()


def same_mixing(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    """Whether two noises are correlated alike; None stands for not at all."""
    if one is None or other is None:
        return one is other
    return bool(np.allclose(one, other, rtol=0.0, atol=SAME * np.abs(one).max()))


@dataclass(frozen=True)
class ProcessEquations:
    """Equations of a process and of what is measured, as CasADi functions; `symbol` makes columns for them.

    space: of the states. inputs, noise: names and numbers of known inputs and of noise. rates: (t, x, u, w, p) -> x' in
    continuous time, or the next state where `step` is true. outputs: name -> (t, x, u, p) -> value.
    intensity: covariance of the noise, per second or per step (nw, nw). parameters: names and values of p.
    """

    space: Manifold
    inputs: dict[str, int]
    noise: dict[str, int]
    rates: Callable[..., Any]
    outputs: dict[str, Callable[..., Any]]
    intensity: np.ndarray
    parameters: dict[str, np.ndarray]
    symbol: Callable[..., Any] = ca.SX.sym
    period: float | None = None

    @property
    def step(self) -> bool:
        """Whether it is in discrete time, with steps of `period`."""
        return self.period is not None

    def columns(self) -> dict[str, Any]:
        """Columns of symbols for all arguments."""
        sizes = {"x": self.space.size, "u": sum(self.inputs.values()), "w": sum(self.noise.values())}
        sizes |= {"t": 1, "p": sum(v.size for v in self.parameters.values())}
        return {name: self.symbol(name, size) for name, size in sizes.items()}


class AnyProcess(Protocol):
    """What a system asks of a process: `ProcessModel`, `DiscreteProcess` and `LinearProcess`."""

    @property
    def noise(self) -> Mapping[str, Any]:
        """Densities, or covariances of a step, by name."""
        ...

    def with_noise(self, **noise: Any) -> AnyProcess:
        """The same process with other noise of these names."""
        ...

    def intensity(self, sizes: Mapping[str, int]) -> np.ndarray:
        """Covariance of the noise (nw, nw), per second or per step, before it is mixed."""
        ...

    def unit_of(self, name: str) -> str:
        """Unit of what may be measured, "?" where none was declared."""
        ...

    def dynamics(self, signals: Sequence[str]) -> ProcessEquations:
        """The equations of the states and of what is measured."""
        ...


class ProcessModel:
    """A compiled model as the process of a filter.

    Args:
        model: any `gt.Model`; what drives it at random is declared as inputs, such as the jerk of a body.
        noise: input -> density of white noise in (unit of the input)^2 s, a number, one per component, or a full matrix
            of them: the integral of the input over a time T has variance density T. Of jerk in m/s3 it is in m2/s5.
        inputs: names of inputs that are known, such as motor forces; `run` takes them as a trajectory.
        states: names such as "T", "der(T)"; the model's own choice if left out.
        quaternions, directions: those of the states that are unit quaternions (scalar first) and unit vectors.
        parameters: names of parameters of the model that `estimate`, or a fault that is looked for, may change.

    Between the rows of a trajectory of known inputs, and between instants, the filter takes the straight line.

    Raises ArgumentError for a wrong name, ModelError where noise and inputs do not determine the rates.

    >>> class Cart(gt.Model):
    ...     x = gt.variable(unit="m")
    ...     v = gt.variable(unit="m/s")
    ...     a = gt.input(unit="m/s2")
    ...     def equations(self):
    ...         yield gt.der(self.x) == self.v
    ...         yield gt.der(self.v) == self.a
    >>> process = gt.filtering.ProcessModel(Cart(), noise={"a": 0.1})  # m2/s3
    >>> process.noise
    {'a': 0.1}
    """

    def __init__(
        self,
        model: Model,
        noise: Mapping[str, Any],
        *,
        inputs: Sequence[str] = (),
        states: Sequence[str] = (),
        quaternions: Sequence[str] = (),
        directions: Sequence[str] = (),
        parameters: Sequence[str] = (),
    ) -> None:
        self.model, self.noise, self.inputs, self.states = model, dict(noise), tuple(inputs), tuple(states)
        self.kinds: dict[str, PartKind] = dict.fromkeys(quaternions, "quaternion")
        self.kinds |= dict.fromkeys(directions, "direction")
        self.parameters = tuple(parameters)
        both = [name for name in self.noise if name in self.inputs]
        if both:
            raise ArgumentError(f"'{both[0]}' is named as noise and as a known input; name it once", "noise")

    def with_noise(self, **noise: Any) -> ProcessModel:
        """The same process with other densities of these noises. Raises ArgumentError for a name that is not there."""
        only_named(noise, self.noise, "noise")
        made = copy(self)
        made.noise = {**self.noise, **noise}
        for name, value in noise.items():
            own, other = (_mixing_of(v, f"noise.{name}") for v in (self.noise[name], value))
            if not same_mixing(own, other):
                sentence = f"noise '{name}' would be correlated in another way; make the process anew"
                raise ArgumentError(sentence, f"noise.{name}")
        return made

    def intensity(self, sizes: Mapping[str, int]) -> np.ndarray:
        """Covariance per second (nw, nw) of noise of these sizes, before it is mixed."""
        return np.diag(densities(self.noise, sizes))

    def unit_of(self, name: str) -> str:
        """Unit of what may be measured, "?" where none was declared."""
        flat = flat_of(self.model)
        _, indices, order = flat.lookup(name)
        return flat.unit_of(indices[0], order)

    def dynamics(self, signals: Sequence[str]) -> ProcessEquations:
        """The equations of the states and of these variables of the model."""
        flat = flat_of(self.model)
        known = [*self.inputs, *self.noise]
        first = compile_causal(flat, known, list(signals), list(self.states))
        order = {pair: n for n, pair in enumerate(first.plan.states)}
        states = list(self.states) or _state_names(first)
        pairs = []
        for name in states:
            shape, indices, k = flat.lookup(name)
            missing = [i for i in indices if (i, k) not in order]
            if missing:
                names = ", ".join(f"'{s}'" for s in _state_names(first))
                raise ArgumentError(f"'{name}' is no state of the model with these inputs; they are {names}", "states")
            pairs.append((name, shape, [(i, k) for i in indices]))
        if len([p for _, _, group in pairs for p in group]) != len(order):
            names = ", ".join(f"'{s}'" for s in _state_names(first))
            raise ArgumentError(f"the states of the model are {names}; name all of them, or none", "states")
        only_named(self.kinds, [name for name, _, _ in pairs], "quaternions")
        parts = [
            StatePart(name, self.kinds.get(name, "vector"), len(group), flat.unit_of(*group[0]))
            for name, _, group in pairs
        ]
        column = {pair: n for n, pair in enumerate(p for _, _, group in pairs for p in group)}
        wanted = [_rate(flat, name) for name, _, group in pairs if not all((i, k + 1) in column for i, k in group)]
        f = compile_causal(flat, known, [*dict.fromkeys([*wanted, *signals])], list(self.states))
        given = _parameters(f, self.parameters)
        function, p_of = (f.casadi_parametric, _chosen(f, given)) if given else (f.casadi, None)
        u_sizes = {name: len(flat.lookup(name)[1]) for name in self.inputs}
        w_sizes = {name: len(flat.lookup(name)[1]) for name in self.noise}
        intensity = self.intensity(w_sizes)
        mixed = {name: _mixing_of(self.noise[name], f"noise.{name}") for name in w_sizes}
        blocks = [np.eye(n) if (W := mixed[name]) is None else W for name, n in w_sizes.items()]
        mix = (
            None
            if all(W is None for W in mixed.values())
            else ca.sparsify(ca.DM(np.asarray(block_diag(*blocks), float)))
        )
        source = dict(column)
        place, offset = {}, len(column)
        for name in known:
            for i in flat.lookup(name)[1]:
                place[(i, 0)] = offset
                offset += 1

        def values(t: Any, x: Any, u: Any, w: Any, p: Any) -> dict[Any, Any]:
            every = ca.vertcat(x, u, w if mix is None else ca.mtimes(mix, w))
            arguments = []
            for signal in f.inputs:
                unknown = [pair for pair in signal.pairs if pair not in source and pair not in place]
                if unknown:
                    raise ArgumentError(
                        f"the model needs {signal.name}, the derivative of an input; make the input smoother, as the "
                        "integral of a noise",
                        "noise",
                    )
                arguments.append(ca.vertcat(*[every[source.get(pair, place.get(pair, 0))] for pair in signal.pairs]))
            arguments += [t] if f.plan.uses_time else []
            arguments += [p_of(p)] if p_of else []
            results = function.call(arguments)
            answers = {pair: r for s, group in zip(f.outputs, results, strict=False) for pair, r in _entries(s, group)}
            if f.margins:  # no answer is no number, which the filter says
                status = results[len(f.outputs)]
                answers = {pair: ca.if_else(status == 0, r, np.nan) for pair, r in answers.items()}
            return answers | {pair: every[n] for pair, n in source.items()}

        def rates(t: Any, x: Any, u: Any, w: Any, p: Any) -> Any:
            answers = values(t, x, u, w, p)
            return ca.vertcat(*[answers[i, k + 1] for _, _, group in pairs for i, k in group])

        def output(name: str) -> Callable[..., Any]:
            _, indices, k = flat.lookup(name)

            def value(t: Any, x: Any, u: Any, p: Any) -> Any:
                answers = values(t, x, u, np.zeros(sum(w_sizes.values())), p)
                return ca.vertcat(*[answers[i, k] for i in indices])

            return value

        return ProcessEquations(
            Manifold(parts), u_sizes, w_sizes, rates, {name: output(name) for name in signals},
            intensity, {name: np.atleast_1d(v) for name, v in given.items()},
            ca.SX.sym if function.is_a("SXFunction") else ca.MX.sym,
        )  # fmt: skip


def densities(noise: Mapping[str, Any], sizes: Mapping[str, int]) -> np.ndarray:
    """Densities of all components of the noise (nw,). Raises ArgumentError for one that is negative or of another
    length."""
    every = []
    for name, size in sizes.items():
        if np.ndim(noise[name]) == 2:
            every.append(np.diag(covariance_matrix(noise[name], size, f"noise.{name}", singular=True)))
            continue
        try:
            value = np.broadcast_to(np.asarray(noise[name], float), (size,))
        except (TypeError, ValueError):
            raise ArgumentError(f"expected a density, or {size}; found {noise[name]!r}", f"noise.{name}") from None
        if not np.all(np.isfinite(value)) or np.any(value < 0):
            raise ArgumentError(f"expected a density of at least 0; found {noise[name]!r}", f"noise.{name}")
        every.append(value)
    return np.concatenate(every) if every else np.zeros(0)


def _mixing_of(value: Any, argument: str) -> np.ndarray | None:
    """What mixes independent noise of these densities; None where they are no matrix."""
    if np.ndim(value) != 2:
        return None
    return mixing(covariance_matrix(value, len(value), argument, singular=True))


def only_named(given: Any, names: Any, argument: str) -> None:
    """Raises ArgumentError for a name that is not among these."""
    for name in given:
        if name not in names:
            there = ", ".join(f"'{n}'" for n in names) or "none"
            raise ArgumentError(f"there is no '{name}'; there are {there}", argument)


def _state_names(f: CausalFunction) -> list[str]:
    return [derivative_name(name, order) for order, name, _, _ in state_groups(f.plan, f.plan.states)]


def _rate(flat: Any, name: str) -> str:
    k = flat.lookup(name)[2]
    base = name if k == 0 else name[4:-1].split(",")[0]
    return f"der({base})" if k == 0 else f"der({base},{k + 1})"


def _entries(signal: Any, column: Any) -> list[tuple[Any, Any]]:
    return [(pair, column[n]) for n, pair in enumerate(signal.pairs)]


def _parameters(f: CausalFunction, names: Sequence[str]) -> dict[str, Any]:
    """Values of parameters by the names of the declarations."""
    values, there = dict(zip(f.parameter_names, f.flat.p0, strict=True)), f.parameter_names
    given = {}
    for name in names:
        own = [n for n in there if n == name or n.startswith(f"{name}[")]
        if not own:
            listed = ", ".join(f"'{n}'" for n in dict.fromkeys(n.split("[")[0] for n in there)) or "none"
            raise ArgumentError(f"the model has no parameter '{name}'; it has {listed}", "parameters")
        given[name] = np.array([values[n] for n in own])
    return given


def _chosen(f: CausalFunction, given: Mapping[str, Any]) -> Callable[[Any], Any]:
    """The whole vector of parameters from those that may change."""
    there = f.parameter_names
    place = {}
    for name in given:
        for n in there:
            if n == name or n.startswith(f"{name}["):
                place[n] = len(place)

    def whole(p: Any) -> Any:
        return ca.vertcat(*[p[place[n]] if n in place else v for n, v in zip(there, f.flat.p0, strict=True)])

    return whole
