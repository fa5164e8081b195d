"""Process of a filter: any compiled model with noise declared as inputs, with a full covariance if the noise is
correlated."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import casadi as ca
import numpy as np
from scipy.linalg import block_diag

from .._lazy import hint
from .._pickling import Portable
from ..compiler.causal import CausalFunction, compile_causal, state_groups
from ..compiler.flat_cache import flat_of
from ..lang.scope import derivative_name
from ..results.refusal import ArgumentError
from .manifold import Manifold, PartKind, StatePart

if TYPE_CHECKING:
    from ..lang.model import Model
else:
    Model = hint("gtmodel.lang.model", "Model")

ROUNDING = 1e-9  # of the largest entry: covariances from other programs are symmetric to this
SINGULAR = 1e-12  # of its trace: eigenvalues above minus this are round-off of zero
SAME = 1e-9  # tolerance between mixing matrices, whose entries are about one


def covariance_matrix(value: Any, size: int, argument: str, *, singular: bool) -> np.ndarray:
    """Check a covariance (size, size) and return it.

    Raises ArgumentError for another shape, and for a matrix that is not symmetric or not positive definite (with
    `singular`, not positive semidefinite).
    """
    try:
        R = np.asarray(value, float)
    except (TypeError, ValueError):
        R = np.full(0, np.nan)
    if R.shape != (size, size) or not np.isfinite(R).all():
        text = f"shape {R.shape}" if R.ndim == 2 and np.isfinite(R).all() else repr(value)
        raise ArgumentError(f"expected a covariance ({size}, {size}) of finite numbers; found {text}", argument)
    if np.abs(R - R.T).max() > ROUNDING * np.abs(R).max():
        i, j = np.unravel_index(int(np.argmax(np.abs(R - R.T))), R.shape)
        sentence = f"expected a symmetric covariance; found {R[i, j]:g} at [{i}, {j}] and {R[j, i]:g} at [{j}, {i}]"
        raise ArgumentError(sentence, argument)
    d = np.sqrt(np.maximum(np.diag(R), 0.0))
    safe = np.where(d > 0, d, 1.0)
    least = float(np.linalg.eigvalsh(R / np.outer(safe, safe) + np.diag(np.where(d > 0, 0.0, 1.0)))[0])
    wrong_axis = bool(np.any(np.diag(R) < 0) or np.any(R[d == 0] != 0))
    if wrong_axis or least < -SINGULAR * size or (not singular and (np.any(d == 0) or least <= SINGULAR)):
        kind = "positive semidefinite" if singular else "positive definite"
        raise ArgumentError(
            f"expected a {kind} covariance; found {'a row without a variance' if wrong_axis else ''}"
            f"{'' if wrong_axis else f'a smallest eigenvalue of {least:.3g} of its correlation matrix'}",
            argument,
        )
    return (R + R.T) / 2


def mixing(R: np.ndarray) -> np.ndarray:
    """Return W with W diag(R) W' = R: W turns independent noise with the variances of R into noise of covariance R.

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
        root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T  # independent of the signs of the vectors
    return safe[:, None] * root / safe


def independent(R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return L and d with L diag(d)^2 L' = R, L lower triangular with ones on its diagonal.

    L^-1 turns numbers of covariance R into independent ones with standard deviations d. Its k-th result depends on the
    first k numbers only, and its determinant is one.

    >>> L, d = independent(np.array([[4.0, 2.0], [2.0, 5.0]]))
    >>> L.tolist(), d.tolist()
    ([[1.0, 0.0], [0.5, 1.0]], [2.0, 2.0])
    """
    root = np.linalg.cholesky(R)
    d = np.diag(root)
    return root / d, d.copy()


def same_mixing(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    """Whether two noises have the same correlations; None: independent."""
    if one is None or other is None:
        return one is other
    return bool(np.allclose(one, other, rtol=0.0, atol=SAME * np.abs(one).max()))


@dataclass(frozen=True)
class ProcessEquations:
    """Equations of a process and of its measured quantities, as CasADi functions; `symbol` makes columns for them.

    space: of the states. inputs, noise: names and sizes of known inputs and noise. rates: (t, x, u, w, p) -> x' in
    continuous time, or the next state if `step` is true. outputs: name -> (t, x, u, p) -> value.
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
        """Whether the process is in discrete time, with steps of `period`."""
        return self.period is not None

    def columns(self) -> dict[str, Any]:
        """Return columns of symbols for all arguments."""
        sizes = {"x": self.space.size, "u": sum(self.inputs.values()), "w": sum(self.noise.values())}
        sizes |= {"t": 1, "p": sum(v.size for v in self.parameters.values())}
        return {name: self.symbol(name, size) for name, size in sizes.items()}


class AnyProcess(Protocol):
    """Interface of a process: `ProcessModel`, `DiscreteProcess` and `LinearProcess`."""

    @property
    def noise(self) -> Mapping[str, Any]:
        """Noise densities, or covariances per step, by name."""
        ...

    def with_noise(self, **noise: Any) -> AnyProcess:
        """Return the same process with other noise of these names."""
        ...

    def intensity(self, sizes: Mapping[str, int]) -> np.ndarray:
        """Return the covariance of the noise (nw, nw), per second or per step, before mixing."""
        ...

    def unit_of(self, name: str) -> str:
        """Unit of a measurable quantity, "?" if none was declared."""
        ...

    def dynamics(self, signals: Sequence[str]) -> ProcessEquations:
        """Return the equations of the states and of the measured quantities."""
        ...


class ProcessModel(Portable):
    """A compiled model as the process of a filter.

    Args:
        model: any `gt.Model`; its random drive is declared as inputs, such as the jerk of a body.
        noise: input -> density of white noise in (unit of the input)^2 s, a number, one per component, or a full
            matrix: the integral of the input over a time T has variance density T. For jerk in m/s3 it is in m2/s5.
        inputs: names of known inputs, such as motor forces; `run` takes them as a trajectory.
        states: names such as "T", "der(T)"; the model's own choice if left out.
        quaternions, directions: names of the states that are unit quaternions (scalar first) and unit vectors.
        parameters: names of model parameters that `estimate` or a search for faults may change.

    Known inputs are linear between the rows of their trajectory and between instants.

    Raises ArgumentError for a wrong name, ModelError if noise and inputs do not determine the rates.

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
        self.kinds: dict[str, PartKind] = {name: "quaternion" for name in quaternions}
        self.kinds.update({name: "direction" for name in directions})  # pyrefly: ignore[no-matching-overload]
        self.parameters = tuple(parameters)
        both = [name for name in self.noise if name in self.inputs]
        if both:
            raise ArgumentError(f"'{both[0]}' is both a noise and a known input; name it once", "noise")

    def with_noise(self, **noise: Any) -> ProcessModel:
        """Return the same process with other densities of these noises. Raises ArgumentError for an unknown name."""
        only_named(noise, self.noise, "noise")
        other_process = copy(self)
        other_process.noise = {**self.noise, **noise}
        for name, value in noise.items():
            own, other = (_mixing_of(v, f"noise.{name}") for v in (self.noise[name], value))
            if not same_mixing(own, other):
                sentence = f"this changes the correlations of noise '{name}'; make a new process instead"
                raise ArgumentError(sentence, f"noise.{name}")
        return other_process

    def intensity(self, sizes: Mapping[str, int]) -> np.ndarray:
        """Return the covariance per second (nw, nw) of noise of these sizes, before mixing."""
        return np.diag(densities(self.noise, sizes))

    def unit_of(self, name: str) -> str:
        """Unit of a measurable quantity, "?" if none was declared."""
        flat = flat_of(self.model)
        _, indices, order = flat.lookup(name)
        return flat.unit_of(indices[0], order)

    def dynamics(self, signals: Sequence[str]) -> ProcessEquations:
        """Return the equations of the states and of these variables of the model."""
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
                raise ArgumentError(f"'{name}' is not a state of the model with these inputs; found {names}", "states")
            pairs.append((name, shape, [(i, k) for i in indices]))
        if len([p for _, _, group in pairs for p in group]) != len(order):
            names = ", ".join(f"'{s}'" for s in _state_names(first))
            raise ArgumentError(f"the states of the model are {names}; name all of them or none", "states")
        only_named(self.kinds, [name for name, _, _ in pairs], "quaternions")
        parts = [
            StatePart(name, self.kinds.get(name, "vector"), len(group), flat.unit_of(*group[0]))
            for name, _, group in pairs
        ]
        column = {pair: n for n, pair in enumerate(p for _, _, group in pairs for p in group)}
        needed = [_rate(flat, name) for name, _, group in pairs if not all((i, k + 1) in column for i, k in group)]
        f = compile_causal(flat, known, [*dict.fromkeys([*needed, *signals])], list(self.states))
        free = _parameters(f, self.parameters)
        function, p_of = (f.casadi_parametric, _chosen(f, free)) if free else (f.casadi, None)
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
                        f"the model needs {signal.name}, the derivative of an input; make the input smoother, such as "
                        "the integral of a noise",
                        "noise",
                    )
                arguments.append(ca.vertcat(*[every[source.get(pair, place.get(pair, 0))] for pair in signal.pairs]))
            arguments += [t] if f.plan.uses_time else []
            arguments += [p_of(p)] if p_of else []
            results = function.call(arguments)
            answers = {pair: r for s, group in zip(f.outputs, results, strict=False) for pair, r in _entries(s, group)}
            if f.margins:  # without a solution the result is NaN, and the filter reports it
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
            intensity, {name: np.atleast_1d(v) for name, v in free.items()},
            ca.SX.sym if function.is_a("SXFunction") else ca.MX.sym,
        )  # fmt: skip


def densities(noise: Mapping[str, Any], sizes: Mapping[str, int]) -> np.ndarray:
    """Densities of all components of the noise (nw,). Raises ArgumentError for a negative one or a wrong length."""
    blocks = []
    for name, size in sizes.items():
        if np.ndim(noise[name]) == 2:
            blocks.append(np.diag(covariance_matrix(noise[name], size, f"noise.{name}", singular=True)))
            continue
        try:
            value = np.broadcast_to(np.asarray(noise[name], float), (size,))
        except (TypeError, ValueError):
            raise ArgumentError(f"expected a density, or {size}; found {noise[name]!r}", f"noise.{name}") from None
        if not np.all(np.isfinite(value)) or np.any(value < 0):
            raise ArgumentError(f"expected a density of at least 0; found {noise[name]!r}", f"noise.{name}")
        blocks.append(value)
    return np.concatenate(blocks) if blocks else np.zeros(0)


def _mixing_of(value: Any, argument: str) -> np.ndarray | None:
    """Mixing matrix of a noise given as a full covariance; None for independent densities."""
    if np.ndim(value) != 2:
        return None
    return mixing(covariance_matrix(value, len(value), argument, singular=True))


def only_named(given: Any, names: Any, argument: str) -> None:
    """Raise ArgumentError for a name that is not among `names`."""
    for name in given:
        if name not in names:
            known = ", ".join(f"'{n}'" for n in names) or "none"
            raise ArgumentError(f"there is no '{name}'; expected one of {known}", argument)


def _state_names(f: CausalFunction) -> list[str]:
    return [derivative_name(name, order) for order, name, _, _ in state_groups(f.plan, f.plan.states)]


def _rate(flat: Any, name: str) -> str:
    k = flat.lookup(name)[2]
    base = name if k == 0 else name[4:-1].split(",")[0]
    return f"der({base})" if k == 0 else f"der({base},{k + 1})"


def _entries(signal: Any, column: Any) -> list[tuple[Any, Any]]:
    return [(pair, column[n]) for n, pair in enumerate(signal.pairs)]


def _parameters(f: CausalFunction, names: Sequence[str]) -> dict[str, Any]:
    """Values of parameters by their declared names."""
    entries = dict(zip(f.parameter_names, f.flat.p0, strict=True))
    values = {}
    for name in names:
        own = [n for n in entries if n == name or n.startswith(f"{name}[")]
        if not own:
            known = ", ".join(f"'{n}'" for n in dict.fromkeys(n.split("[")[0] for n in entries)) or "none"
            raise ArgumentError(f"the model has no parameter '{name}'; it has {known}", "parameters")
        values[name] = np.array([entries[n] for n in own])
    return values


def _chosen(f: CausalFunction, free: Mapping[str, Any]) -> Callable[[Any], Any]:
    """Function from the free parameters to all parameters."""
    names = f.parameter_names
    place = {}
    for name in free:
        for n in names:
            if n == name or n.startswith(f"{name}["):
                place[n] = len(place)

    def whole(p: Any) -> Any:
        return ca.vertcat(*[p[place[n]] if n in place else v for n, v in zip(names, f.flat.p0, strict=True)])

    return whole
