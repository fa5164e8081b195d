"""Unknowns of one kind, local or fixed, with their increments; residuals of one kind, with their unknowns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ...compiler.rows import map_columns
from ...geometry.quaternions import logarithm, small_turn, turned
from ...geometry.rotations import inverse_right_jacobian
from ...results.refusal import ArgumentError
from ..weighting import Weighting, loss_named, weighting

AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class UnknownGroup:
    """Unknowns of one kind, such as cameras or poses: `start` (count, size), one instance per row.

    name: of the group, for residual blocks and `BundleFit.values`.
    labels: names of the `size` entries of an instance; keys: names of the `count` instances, by default "name 1" and so
        on, or the group's name for a single instance. Together they name an unknown, as in "left.fx".
    turn: position of the first of four entries of a unit quaternion, scalar first, frame to outer coordinates; None
        without. Its increment is a rotation vector in its own frame, q (1, d / 2) / |..|, so an instance has
        `moves` = size - 1 degrees of freedom; the labels of the three are "turn_x", "turn_y", "turn_z" [rad].
    local: whether instances are eliminated: there may be many, and a residual should depend on only one of them.
        Instances that share a residual are kept with the shared unknowns.
    fixed: mask (count, moves) or (moves,) of entries that do not change; none by default.
    units: of the `moves` entries as reported; empty if unknown.

    Raises ArgumentError for shapes that do not fit.

    >>> poses = gt.inference.bundle.UnknownGroup("pose", np.tile([1.0, 0, 0, 0, 0, 0, 2.0], (3, 1)),
    ...     ["qw", "qx", "qy", "qz", "x", "y", "z"], turn=0, local=True)
    >>> poses.count, poses.size, poses.moves, poses.names[6:9]
    (3, 7, 6, ('pose 2.turn_x', 'pose 2.turn_y', 'pose 2.turn_z'))
    """

    name: str
    start: np.ndarray
    labels: Sequence[str]
    keys: Sequence[str] = ()
    turn: int | None = None
    local: bool = False
    fixed: ArrayLike | None = None
    units: Sequence[str] = ()
    free: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        put = object.__setattr__
        start = np.array(self.start, float, ndmin=2)
        put(self, "start", start)
        put(self, "labels", tuple(self.labels))
        if start.ndim != 2 or len(self.labels) != start.shape[1] or not np.all(np.isfinite(start)):
            raise ArgumentError(
                f"'{self.name}' has starting values of the shape {start.shape} and {len(self.labels)} labels; expected "
                "finite values (count, size) and a label for each of the size"
            )
        keys = tuple(self.keys) or tuple(
            self.name if len(start) == 1 else f"{self.name} {k + 1}" for k in range(len(start))
        )
        put(self, "keys", keys)
        if len(keys) != len(start) or len(set(keys)) < len(keys):
            raise ArgumentError(f"expected {len(start)} different keys of '{self.name}'; found {keys[:5]}")
        if self.turn is not None:
            length = np.linalg.norm(start[:, self.turn : self.turn + 4], axis=1)
            if self.turn + 4 > start.shape[1] or np.any(np.abs(length - 1) > 1e-6):
                raise ArgumentError(
                    f"'{self.name}' has quaternions of length {length.min():g} to {length.max():g}; expected 1"
                )
            start[:, self.turn : self.turn + 4] /= length[:, None]
        mask = np.zeros((1, self.moves), bool) if self.fixed is None else np.atleast_2d(np.asarray(self.fixed, bool))
        if mask.shape not in ((1, self.moves), (len(start), self.moves)):
            raise ArgumentError(
                f"'fixed' of '{self.name}' has the shape {mask.shape}; expected ({len(start)}, {self.moves})"
            )
        put(self, "free", np.broadcast_to(~mask, (len(start), self.moves)).copy())

    @property
    def count(self) -> int:
        """Number of instances."""
        return self.start.shape[0]

    @property
    def size(self) -> int:
        """Number of entries of an instance."""
        return self.start.shape[1]

    @property
    def moves(self) -> int:
        """Number of degrees of freedom of an instance."""
        return self.size - (self.turn is not None)

    @cached_property
    def move_labels(self) -> tuple[str, ...]:
        """Labels of the `moves` entries; a quaternion has turn_x, turn_y and turn_z."""
        if self.turn is None:
            return tuple(self.labels)
        return (*self.labels[: self.turn], *(f"turn_{a}" for a in AXES), *self.labels[self.turn + 4 :])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all count * moves entries, instance by instance."""
        return tuple(f"{k}.{label}" for k in self.keys for label in self.move_labels)

    def moved(self, values: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return values (n, size) after increments (n, moves)."""
        if self.turn is None:
            return values + step
        t = self.turn
        changed = turned(values[:, t : t + 4], step[:, t : t + 3])
        return np.hstack([values[:, :t] + step[:, :t], changed, values[:, t + 4 :] + step[:, t + 3 :]])

    def moved_sx(self, values: ca.SX, step: ca.SX) -> ca.SX:
        """Return the same for one instance of symbols, to first order in the step."""
        if self.turn is None:
            return values + step
        t = self.turn
        changed = small_turn(values[t : t + 4], step[t : t + 3] / 2)
        return ca.vertcat(values[:t] + step[:t], changed, values[t + 4 :] + step[t + 3 :])

    def reported(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Return reported values (count, moves), with rotation vectors [rad] for quaternions, and the derivative of
        these by the increments (count, 3, 3); None without quaternions."""
        if self.turn is None:
            return values, None
        t = self.turn
        vectors = logarithm(values[:, t : t + 4])
        return np.hstack([values[:, :t], vectors, values[:, t + 4 :]]), inverse_right_jacobian(vectors)


@dataclass(frozen=True, eq=False)
class ResidualBlock:
    """n observations of one kind: `function(instance, ..., data)` -> residuals (m,), for each observation.

    name: of the observations, in residuals and errors.
    function: an SX function; its first inputs are instances of unknowns, a column of `size` entries each, in the order
        of `sees`; the last is the data of the observation, if any. An optional second output is a margin (k,) that must
        stay positive: a step that makes one of them negative is rejected.
    sees: pairs (name of the group, indices (n,) of the instance of each observation); a single number is the same
        instance for all. `seen` holds them as arrays, `rows` the data (n, d).
    data: (n, d), or (n,) for one number each; None if the function takes none.
    sigma: standard deviation of the noise, one number, (n,) or (n, m); covariance: (n, m, m). None if unknown, and then
        for all blocks.
    loss: of the length of the m whitened residuals of an observation: linear, huber, soft_l1 or cauchy, with its
        `width` in standard deviations.

    Raises ArgumentError if these do not match.

    >>> import casadi as ca
    >>> a, z, y = ca.SX.sym("a"), ca.SX.sym("z"), ca.SX.sym("y")
    >>> f = ca.Function("line", [a, z, y], [a + z - y])
    >>> block = gt.inference.bundle.ResidualBlock("sums", f, [("a", 0), ("z", [0, 1, 1])], data=[1.0, 2.0, 2.5])
    >>> block.n, block.m
    (3, 1)
    """

    name: str
    function: ca.Function
    sees: Sequence[tuple[str, ArrayLike]]
    data: ArrayLike | None = None
    sigma: ArrayLike | None = None
    covariance: ArrayLike | None = None
    loss: str = "linear"
    width: float = 2.0
    n: int = field(init=False)
    seen: tuple[tuple[str, np.ndarray], ...] = field(init=False)
    rows: np.ndarray | None = field(init=False)

    def __post_init__(self) -> None:
        put = object.__setattr__
        loss_named(self.loss)
        data = None if self.data is None else np.asarray(self.data, float)
        if data is not None and data.ndim == 1:
            data = data[:, None]
        lengths = {len(i) for _, i in self._indices()} | ({len(data)} if data is not None else set())
        if len(lengths - {1}) > 1 or not lengths:
            raise ArgumentError(f"expected as many indices as rows of data in '{self.name}'; found {sorted(lengths)}")
        n = max(lengths) if lengths != {0, 1} else 0
        put(self, "n", n)
        put(self, "seen", tuple((g, np.broadcast_to(i, n)) for g, i in self._indices()))
        put(self, "rows", data)
        inputs = len(self.sees) + (data is not None)
        if self.function.n_in() != inputs or self.function.n_out() not in (1, 2):
            raise ArgumentError(
                f"the function of '{self.name}' has {self.function.n_in()} inputs and {self.function.n_out()} outputs; "
                f"expected {inputs} inputs and residuals, with a margin or without"
            )

    def _indices(self) -> list[tuple[str, np.ndarray]]:
        return [(g, np.atleast_1d(np.asarray(i, int))) for g, i in self.sees]

    @property
    def m(self) -> int:
        """Number of residuals of an observation."""
        return int(self.function.size1_out(0))

    def weighting(self) -> Weighting:
        """Return the weighting of the n * m rows."""
        if self.covariance is not None:
            return weighting(self.n * self.m, covariance=self.covariance)
        sigma = self.sigma
        if sigma is not None:
            s = np.asarray(sigma, float)
            if s.shape == (self.n,) and self.m > 1:
                s = np.repeat(s, self.m)
            sigma = s.reshape(-1) if s.ndim else s
        return weighting(self.n * self.m, sigma=sigma)


@dataclass(eq=False)
class Linearised:
    """A block at some values: whitened residuals `r` (n, m), and their derivatives `J` by instance, each (n, m, moves),
    both multiplied by the weight of the loss; `cost` is the cost of the loss."""

    r: np.ndarray
    J: list[np.ndarray]
    cost: float


class BlockEvaluation:
    """Evaluates residuals and derivatives of a block: one function for all observations, in the order `order`."""

    def __init__(self, block: ResidualBlock, groups: Mapping[str, UnknownGroup], order: np.ndarray) -> None:
        self.block, self.n = block, len(order)
        self.groups = [groups[name] for name, _ in block.seen]
        self.index = [np.ascontiguousarray(i[order]) for _, i in block.seen]
        self.data = None if block.rows is None else np.ascontiguousarray(block.rows[order].T)
        w = block.weighting()
        self.known = w.known
        f = w.factor
        if f is not None and f.ndim == 1 and len(f) == block.n * block.m and len(f) > 1:
            f = f.reshape(block.n, block.m)[order]
        elif f is not None and f.ndim == 3:
            f = f[order]
        self.factor = f
        self.loss = loss_named(block.loss)
        self.free = [None if g.free.all() else g.free for g in self.groups]
        self.residual, self.slopes = self._functions()
        self._maps: dict[int, dict[int, ca.Function]] = {}

    def _functions(self) -> tuple[ca.Function, ca.Function]:
        block = self.block
        x = [ca.SX.sym(f"x{k}", g.size) for k, g in enumerate(self.groups)]
        d = [ca.SX.sym(f"d{k}", g.moves) for k, g in enumerate(self.groups)]
        data = [ca.SX.sym("data", self.data.shape[0])] if self.data is not None else []
        for k, v in enumerate([*x, *data]):
            if block.function.numel_in(k) != v.numel():
                raise ArgumentError(
                    f"input {k + 1} of the function of '{block.name}' has {block.function.numel_in(k)} entries; "
                    f"expected {v.numel()}"
                )
        moved = [g.moved_sx(a, b) for g, a, b in zip(self.groups, x, d, strict=True)]
        out: Any = block.function.call([*moved, *data])
        zero = [ca.DM.zeros(v.numel()) for v in d]
        plain = [ca.densify(e) for e in ca.substitute(list(out), d, zero)]
        J = ca.substitute([ca.jacobian(out[0], v) for v in d], d, zero)
        names = f"block_{len(x)}"
        residual = ca.Function(names, [*x, *data], plain, {"cse": True})
        # transposed, so that the rows of an observation are contiguous in memory
        slopes = ca.Function(f"{names}_jacobian", [*x, *data], [*plain, *[ca.densify(j.T) for j in J]], {"cse": True})
        return residual, slopes

    def _called(self, f: ca.Function, values: Mapping[str, np.ndarray]) -> list[np.ndarray]:
        """Outputs as (n, entries)."""
        columns = [values[g.name][i].T for g, i in zip(self.groups, self.index, strict=True)]
        if self.data is not None:
            columns.append(self.data)
        results = map_columns(f, columns, self._maps.setdefault(f.__hash__(), {}))
        return [r.T.reshape(self.n, f.numel_out(k)) for k, r in enumerate(results)]

    def raw(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return residuals (n, m), neither whitened nor weighted."""
        return self._called(self.residual, values)[0]

    def invalid(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the mask (n,) of observations with a margin that is not positive, or a residual that is not finite."""
        r, *margin = self._called(self.residual, values)
        bad = np.any(~np.isfinite(r), axis=1)
        for m in margin:
            bad = np.logical_or(bad, np.any(~(m > 0), axis=1))
        return np.asarray(bad, bool)

    def cost(self, values: Mapping[str, np.ndarray]) -> float:
        """Return the cost, infinite if a margin is not positive."""
        r, *margin = self._called(self.residual, values)
        if margin and not np.all(margin[0] > 0):
            return np.inf
        return self._cost(self._whitened(r))

    def _cost(self, r: np.ndarray) -> float:
        if self.loss.squares:
            return 0.5 * float(np.vdot(r, r))
        return self.loss.cost(np.sqrt(np.einsum("ni,ni->n", r, r)), self.block.width)

    def linearised(self, values: Mapping[str, np.ndarray], robust: bool = True) -> Linearised:
        """Linearise at these values; without the weights of the loss if not `robust`."""
        outputs = self._called(self.slopes, values)
        margins = len(outputs) - 1 - len(self.groups)
        n, m = self.n, self.block.m
        r = self._whitened(outputs[0])
        J = [self._whitened(j.reshape(n, m, -1)) for j in outputs[1 + margins :]]
        cost = self._cost(r) if not margins or np.all(outputs[1] > 0) else np.inf
        for k, free in enumerate(self.free):
            if free is not None:
                J[k] = J[k] * free[self.index[k]][:, None, :]
        if robust and not self.loss.squares:
            weight = self.loss.weight(np.sqrt(np.einsum("ni,ni->n", r, r)), self.block.width)
            r, J = r * weight[:, None], [j * weight[:, None, None] for j in J]
        return Linearised(r, J, cost)

    def _whitened(self, rows: np.ndarray) -> np.ndarray:
        f = self.factor
        if f is None:
            return rows
        if f.ndim == 3:
            return np.matmul(f, rows if rows.ndim == 3 else rows[:, :, None]).reshape(rows.shape)
        if f.size == 1:
            return rows if float(f.reshape(-1)[0]) == 1.0 else rows * float(f.reshape(-1)[0])
        return rows * f.reshape(*f.shape, *[1] * (rows.ndim - 2))
