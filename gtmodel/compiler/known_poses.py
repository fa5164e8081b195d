"""Known rotation matrices and positions: they count as the degrees of freedom that they fix.

A known rotation matrix has nine numbers for three degrees of freedom. The matrix of the model becomes an unknown beside
the known one, and three equations say that no rotation is left between them. If position and rotation of a frame are
known and the mechanism has fewer degrees of freedom, as many equations are solved; the others are conditions on the
solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import casadi as ca

from .alias import AliasResult
from .blocks import Margin, SolvedBlock
from .degrees_of_freedom import degrees_of_freedom, known_rotations
from .flat import FlatEquation, FlatModel
from .relevance import CONDITION_TOLERANCE

AXES = "xyz"
LAST = -9  # preference as a state of the model's values beside known ones

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class _Known:
    """A known variable: name, scalar indices, and the values of the model, in the same order."""

    name: str
    indices: list[int]
    model: ca.SX

    def column(self, flat: FlatModel) -> ca.SX:
        return ca.vertcat(*[flat.scope.symbol(i, 0) for i in self.indices])


@dataclass(frozen=True, eq=False)
class KnownPose:
    """A model with known rotations, rewritten.

    `flat`: the model with unknown copies of the known values. `exact`: equations between the two, element by element,
    for consistent points, where they stand for the equations `replaced`, by label. `left`: equations that are
    conditions on the solution, each with the size that it is compared with. `copies`: the known variables with a copy,
    `rotations` the rotation matrices among them. `known`: indices of the known positions and rotations.
    """

    flat: FlatModel
    exact: tuple[FlatEquation, ...]
    replaced: frozenset[str]
    left: tuple[tuple[FlatEquation, float], ...]
    copies: tuple[_Known, ...]
    rotations: tuple[_Known, ...]
    known: frozenset[int]

    @property
    def read(self) -> list[Pair]:
        """The symbols that the conditions on the solution read."""
        columns = [c.model for c in self.copies]
        columns += [c.column(self.flat) for c in self.copies] if self.left else []
        return list(self.flat.scope.symbols_in(ca.vertcat(*columns)))

    def at_points(self, alias: AliasResult, stages: list[ca.SX], pairs: Sequence[Pair]) -> list[ca.SX]:
        """Return the stages with equations, element by element, that exclude half turns and unreachable values."""
        residuals = [r for r in alias.rewrite_all(self.flat, [e.residual for e in self.exact]) if not r.is_zero()]
        inside, stages = set(pairs), list(stages)
        for m in range(len(stages)):
            residuals = [r for r in residuals if inside.issuperset(self.flat.scope.symbols_in(r))]
            if not residuals:
                break
            stages[m] = ca.vertcat(stages[m], *residuals)
            residuals = [self.flat.scope.derivative(r) for r in residuals]
        return stages

    def reflections(self) -> list[Margin]:
        """Return margins that are negative if a known matrix is a reflection."""
        matrices = [_matrix(r.column(self.flat)) for r in self.rotations]
        labels = [f"{r.name} is a rotation matrix ({self.flat.variables[r.indices[0]].where})" for r in self.rotations]
        return [
            Margin("condition", ca.dot(ca.cross(m[:, 0], m[:, 1]), m[:, 2]), label)
            for m, label in zip(matrices, labels, strict=True)
        ]

    def condition_blocks(self, alias: AliasResult, newton: bool) -> list[SolvedBlock]:
        """Return a block whose margins are negative if a solution does not satisfy what is left; none without any.

        newton: a solution may have been found on the wrong side of a rotation, turned by half a turn.
        """
        margins = [
            Margin("solution", (CONDITION_TOLERANCE * size) ** 2 - e.residual**2, f"{e.label} ({e.where})")
            for e, size in self.left
        ]
        for r in self.rotations if newton else ():
            trace = ca.dot(r.column(self.flat), r.model)  # 3 for equal matrices, at most 1 after half a turn
            margins.append(Margin("turn", trace - 2.0, f"{r.name}, but half a turn from it"))
        if not margins:
            return []
        expressions = alias.rewrite_all(self.flat, [m.expression for m in margins])
        margins = [replace(m, expression=e) for m, e in zip(margins, expressions, strict=True)]
        labels = [m.label for m in margins]
        return [SolvedBlock("condition", [], labels, [], margins, detail="condition on the solution")]


def known_pose(flat: FlatModel, known: Sequence[int]) -> KnownPose | None:
    """Return the model rewritten for its known rotation matrices; None if no whole rotation matrix is known."""
    key = "known pose", frozenset(known)
    if key not in flat.cache:
        if (old := flat.source) is not None:  # rewritten before, and now with other parameters
            variables = flat.variables[: len(old.variables)]
            return known_pose(replace(old, parameters=flat.parameters, variables=variables, cache={}), known)
        flat.cache[key] = pose = _known_pose(flat, frozenset(known))
        if pose is not None:
            pose.flat.cache[key] = pose
    return flat.cache[key]


def _known_pose(flat: FlatModel, known: frozenset[int]) -> KnownPose | None:
    whole = known_rotations(flat, known)
    if not whole:
        return None
    fixed = degrees_of_freedom(flat, known)
    dropped = fixed.dropped
    scope = copy(flat.scope)  # the new variables are those of the new model alone
    scope.chains, scope.names = [*scope.chains], [*scope.names]
    variables, old, new = [*flat.variables], list[ca.SX](), list[ca.SX]()
    copies, rotations, left = list[_Known](), list[_Known](), list[tuple[FlatEquation, float]]()
    exact, rows = list[FlatEquation](), list[FlatEquation]()

    def reached(name: str, indices: list[int]) -> _Known:
        first = len(variables)
        for i in indices:
            v = flat.variables[i]
            scope.new_chain(f"reached {v.name}")
            variables.append(replace(v, name=f"reached {v.name}", index=len(variables), role="variable", prefer=LAST))
        symbols = [scope.symbol(first + k, 0) for k in range(len(indices))]
        for k, i in enumerate(indices):
            old.extend(scope.symbol(i, m) for m in range(len(scope.chains[i])))
            new.extend(scope.symbol(first + k, m) for m in range(len(scope.chains[i])))
        return _Known(name, indices, ca.vertcat(*symbols))

    def rows_of(group: _Known, residuals: ca.SX, labels: list[str], sizes: float) -> None:
        v = flat.variables[group.indices[0]]
        for k, label in enumerate(labels):
            equation = FlatEquation(residuals[k], label, v.component, v.where)
            if (group.name, k) in dropped:
                left.append((equation, sizes))
            else:
                rows.append(equation)

    for name, indices in fixed.groups:
        rotation = name in whole
        if not rotation and not any((name, k) in dropped for k in range(3)):
            continue
        group = reached(name, indices)
        copies.append(group)
        v = flat.variables[indices[0]]
        column = group.column(flat)
        for i, residual in zip(indices, ca.vertsplit(column - group.model), strict=True):
            label = f"{flat.variables[i].name} as known"
            exact.append(FlatEquation(residual, label, v.component, v.where))
        if rotation:
            rotations.append(group)
            error = _error(_matrix(group.model), _matrix(column))
            rows_of(group, error, [f"rotation of {name} about {axis}" for axis in AXES], 1.0)
            gram = _matrix(column).T @ _matrix(column) - ca.DM.eye(3)
            for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
                rows.append(FlatEquation(gram[i, j], f"{name} is a rotation matrix", v.component, v.where))
        else:
            labels = [f"{flat.variables[i].name} as known" for i in indices]
            rows_of(group, column - group.model, labels, fixed.reach(indices))
    residuals = ca.substitute([e.residual for e in flat.equations], [ca.vertcat(*old)], [ca.vertcat(*new)])
    equations = [replace(e, residual=r) for e, r in zip(flat.equations, residuals, strict=True)]
    changed = replace(flat, scope=scope, variables=variables, equations=[*equations, *rows], source=flat, cache={})
    labels = frozenset(e.label for e in rows)
    indices = frozenset(i for _, group in fixed.groups for i in group)
    return KnownPose(changed, tuple(exact), labels, tuple(left), tuple(copies), tuple(rotations), indices & known)


def _matrix(column: ca.SX) -> ca.SX:
    """Return the matrix of nine elements that are ordered by rows."""
    return ca.reshape(column, 3, 3).T


def _error(model: ca.SX, known: ca.SX) -> ca.SX:
    """Return the rotation from the known matrix to the model's in world axes: sin(angle) times the axis.

    It has the derivatives of the rotation vector where both are equal. If the known matrix moves on a straight line
    between two rotations, its zero moves along the shortest rotation between them.
    """
    turn = model @ known.T
    return ca.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]) / 2
