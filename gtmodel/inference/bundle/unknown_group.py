"""Unknowns of one kind: their values, which of them are local or fixed, and how they move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ...geometry.quaternions import logarithm, small_turn, turned
from ...geometry.rotations import inverse_right_jacobian
from ...results.refusal import ArgumentError

AXES = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class UnknownGroup:
    """Unknowns of one kind, such as cameras or poses: `start` (count, size), one instance per row.

    name: by which residual blocks ask for them, and `BundleFit.values` holds them.
    labels: names of the `size` entries of an instance; keys: names of the `count` instances, by default "name 1" and so
        on, or the group's name where there is one. Together they name an unknown, as "left.fx".
    turn: position of the first of four entries that are a unit quaternion, scalar first, frame to outer coordinates;
        None without. It moves by a rotation vector in its own frame, q (1, d / 2) / |..|, so that an instance has
        `moves` = size - 1 degrees of freedom; labels of the three are "turn_x", "turn_y", "turn_z" [rad].
    local: whether instances are eliminated: there may be many, and no residual should see two of them. Those that one
        does see together are kept with the others.
    fixed: what does not move, a mask (count, moves) or (moves,); nothing by default.
    units: of the `moves` entries as they are reported; empty where unknown.

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
            raise ArgumentError(f"'{self.name}' has {len(start)} instances and the keys {keys[:5]}; give each its own")
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
        """How many instances there are."""
        return self.start.shape[0]

    @property
    def size(self) -> int:
        """How many numbers an instance has."""
        return self.start.shape[1]

    @property
    def moves(self) -> int:
        """How many degrees of freedom an instance has."""
        return self.size - (self.turn is not None)

    @cached_property
    def move_labels(self) -> tuple[str, ...]:
        """Labels of the `moves` entries: those of a quaternion become turn_x, turn_y and turn_z."""
        if self.turn is None:
            return tuple(self.labels)
        return (*self.labels[: self.turn], *(f"turn_{a}" for a in AXES), *self.labels[self.turn + 4 :])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all count * moves entries, instance by instance."""
        return tuple(f"{k}.{label}" for k in self.keys for label in self.move_labels)

    def moved(self, values: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Values (n, size) after increments (n, moves)."""
        if self.turn is None:
            return values + step
        t = self.turn
        changed = turned(values[:, t : t + 4], step[:, t : t + 3])
        return np.hstack([values[:, :t] + step[:, :t], changed, values[:, t + 4 :] + step[:, t + 3 :]])

    def moved_sx(self, values: ca.SX, step: ca.SX) -> ca.SX:
        """The same on one instance of symbols, to first order in the step."""
        if self.turn is None:
            return values + step
        t = self.turn
        changed = small_turn(values[t : t + 4], step[t : t + 3] / 2)
        return ca.vertcat(values[:t] + step[:t], changed, values[t + 4 :] + step[t + 3 :])

    def reported(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Numbers (count, moves) for people, quaternions as rotation vectors [rad], and how these move with the
        increments, (count, 3, 3); None without quaternions."""
        if self.turn is None:
            return values, None
        t = self.turn
        vectors = logarithm(values[:, t : t + 4])
        return np.hstack([values[:, :t], vectors, values[:, t + 4 :]]), inverse_right_jacobian(vectors)
