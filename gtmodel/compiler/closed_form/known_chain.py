"""Closed forms of serial chains: joint coordinates from the pose of a frame, with named branches.

A block that Newton's method would solve may be the inverse kinematics of a chain of joints. The forward kinematics, a
causality of its own, shows it: if it is a product of exponentials, `geometry.chains` finds a closed form from the axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...geometry.chains import Chain, closed_form
from ...geometry.chains.search import ChainSearch
from ...lang.source import ModelError
from ..alias import AliasResult
from ..blocks import Margin, NewtonBlock, Root, SolvedBlock
from ..consistency.points import Sampler
from ..degrees_of_freedom import degrees_of_freedom
from ..flat import FlatModel
from ..rows import map_columns
from .quadric import nearest_turn

if TYPE_CHECKING:
    from ..plan import CausalPlan

Pair = tuple[int, int]
Forward = Callable[[Sequence[int], Sequence[Pair]], "CausalPlan"]

# a known coordinate may be missing if the joints do not change it, relative to the size of the chain
CLOSED = "closed form"  # kind of the block
SINGULAR_START = 1e-9  # a slope of a root below it, of size one or a length, is zero: the start selects no branch
CONSTANT = 1e-12
TRIALS = 4
DECIMALS = 7  # of guesses, in rad and m


@dataclass(frozen=True, eq=False)
class KnownChain:
    """A serial chain whose pose is known.

    `joints`: the indices of its coordinates; `kept`: sign and symbol (index, order) that stand for each; `T`, `R`: the
    known pose, R is None if only the position is known; `closures`: what the joints reach less the known numbers, in
    terms of `kept`; `given`: the known symbols of the pose, and `place` their places in T and the rows of R. `locked`:
    sign and symbol of known joints at the ends of the `whole` chain, which move `T` and `R`; `free`: the places of the
    other joints in it.
    """

    flat: FlatModel
    chain: Chain
    joints: list[int]
    kept: list[tuple[float, Pair]]
    T: ca.SX
    R: ca.SX | None
    closures: ca.SX
    given: list[Pair]
    place: list[int]
    locked: list[tuple[float, Pair]]
    whole: Chain
    free: list[int]

    @property
    def symbols(self) -> list[Pair]:
        return [pair for _, pair in self.kept]

    @property
    def read(self) -> list[Pair]:
        """All known symbols."""
        return [*self.given, *(pair for _, pair in self.locked)]

    @property
    def has_conditions(self) -> bool:
        """Whether more numbers of the pose are known than the chain has joints."""
        return len(self.joints) < (6 if self.R is not None else 3)

    def pose_values(self, q: np.ndarray, locked: np.ndarray) -> np.ndarray:
        """Return the known values (m, given) at joint coordinates q (m, n), for known ones (m, locked)."""
        joints = np.empty((len(q), len(self.whole)))
        joints[:, self.free] = q
        joints[:, [k for k in range(len(self.whole)) if k not in self.free]] = locked
        T, R = self.whole.pose(joints)
        return np.hstack([T, R.reshape(-1, 9)])[:, self.place]

    @property
    def limits(self) -> np.ndarray:
        """Lower and upper limits of the coordinates (n, 2)."""
        return np.array([[self.flat.variables[i].min, self.flat.variables[i].max] for i in self.joints])

    def limit_margins(self, values: Sequence[ca.SX]) -> list[Margin]:
        """Return margins that are negative for coordinates outside their limits."""
        margins = []
        for i, q in zip(self.joints, values, strict=True):
            v = self.flat.variables[i]
            label = f"{v.name}, {v.min:.4g} to {v.max:.4g} {v.unit or ''}".rstrip()
            margins += [Margin("limit", q - v.min, label)] if np.isfinite(v.min) else []
            margins += [Margin("limit", v.max - q, label)] if np.isfinite(v.max) else []
        return margins

    def newton_margins(self) -> SolvedBlock:
        """Return a block with the limits of joints that Newton's method finds, and the reach of the chain."""
        margins = self.limit_margins([sign * self.flat.scope.symbol(*pair) for sign, pair in self.kept])
        if all(self.chain.revolute):
            centre = self.chain.T
            for h, o in zip(self.chain.axes[::-1], self.chain.points[::-1], strict=True):
                centre = o + h * (h @ (centre - o))
            off = self.T - ca.SX(centre)
            size = (1 + 1e-9) * self.chain.size
            label = f"a distance of {size:.4g} m from joint 1 at most"
            margins.insert(0, Margin("condition", size**2 - ca.dot(off, off), label))
        return SolvedBlock("condition", [], [], [], margins, detail="reach and limits")

    @cached_property
    def solved(self) -> SolvedBlock | None:
        """The block that computes the joints in closed form, None without a closed form."""
        flat, names = self.flat, [self.flat.variables[i].name for i in self.joints]
        form = closed_form(self.chain, oriented=self.R is not None)
        if form is None:
            return None
        signs = [ca.SX.sym(b.name) for b in form.branches]
        expressions = form.expressions(self.T, self.R, signs)
        q = [_turned(x, *limits) if turns else x
             for x, limits, turns in zip(expressions.q, self.limits, self.chain.revolute, strict=True)]  # fmt: skip
        margins = [Margin(kind, e, _label(label, names)) for kind, e, label in expressions.margins]
        margins += self.limit_margins(q)
        symbols = [flat.scope.symbol(*pair) for pair in self.symbols]
        assignments = [(s, sign * x) for s, x, (sign, _) in zip(symbols, q, self.kept, strict=True)]
        slopes = form.slopes(ca.vertcat(*[sign * s for s, (sign, _) in zip(symbols, self.kept, strict=True)]))
        at_start = np.asarray(form.slope_function(self.declared[0]).full())[:, 0]
        roots = []
        for sign, slope, b, value in zip(signs, slopes, form.branches, at_start.tolist(), strict=True):
            decided = self.started and abs(value) > SINGULAR_START
            label = f"{b.name}, {b.words[0]} (+) or {b.words[1]} (-)"
            first = -1 if decided and value < 0 else 1
            roots.append(Root(sign, slope, label, first, name=b.name, default=not decided))
        closures = tuple(ca.vertsplit(self.closures))
        equations = [f"the pose of the chain of {', '.join(names)}"]
        unknowns = [s.name() for s in symbols]
        return SolvedBlock(CLOSED, unknowns, equations, assignments, margins, roots, form.structure, closures=closures)

    def regular_starts(self, sampler: Sampler, samples: np.ndarray) -> dict[Pair, float]:
        """Return start values of the joints for a pose that is not singular; empty if the first sample is regular."""
        places = [sampler.position[pair] for pair in self.symbols]
        q = np.array([sign * samples[0][n] for n, (sign, _) in zip(places, self.kept, strict=True)])
        other = ChainSearch(self.chain, self.limits, q[None], self.R is not None).regular(q)
        if other is q:
            return {}
        return {pair: float(sign * x) for x, (sign, pair) in zip(other, self.kept, strict=True)}

    def is_solved_by(self, blocks: Sequence[NewtonBlock]) -> bool:
        """Return whether these blocks are one, and its unknowns are the joints of the chain."""
        owners = [self.flat.scope.owner(u) for b in blocks for u in b.unknowns]
        return len(blocks) == 1 and None not in owners and sorted(filter(None, owners)) == sorted(self.symbols)

    def starts(self, block: NewtonBlock, a: ca.SX) -> ChainStarts:
        """Return starts for a Newton block in the joints of the chain, with the known values in the column `a`."""
        order = np.array([self.symbols.index(p) for p in map(self.flat.scope.owner, block.unknowns) if p is not None])
        signs = np.array([sign for sign, _ in self.kept])[order]
        R = ca.SX(ca.DM.eye(3)) if self.R is None else self.R
        pose = ca.Function("pose", [a], [ca.densify(self.T), ca.densify(ca.vec(R))])
        return ChainStarts(ChainSearch(self.chain, self.limits, self.declared, self.R is not None), pose, order, signs)

    @property
    def started(self) -> bool:
        """Whether a joint has a start value."""
        return any(self.flat.variables[i].start is not None for i in self.joints)

    @property
    def start_text(self) -> str:
        """The start of the joints, which selects the branches of a closed form, as explain() prints it."""
        names = {tuple(indices): name for name, (_, indices) in self.flat.groups.items() if len(indices) > 1}
        numbers = [f"{x + 0.0:.6g}" for x in self.declared[0]]
        if (name := names.get(tuple(self.joints))) is not None:
            return f"{name} = [{', '.join(numbers)}]"
        return ", ".join(f"{self.flat.variables[i].name} = {x}" for i, x in zip(self.joints, numbers, strict=True))

    @property
    def declared(self) -> np.ndarray:
        """Declared starts of the coordinates (k, n), the first from the variables, others from `further_starts`."""
        rows = [[self.flat.variables[i].start or 0.0 for i in self.joints]]
        for name, starts in getattr(type(self.flat.root), "further_starts", {}).items():
            indices = self.flat.groups[name][1] if name in self.flat.groups else []
            if set(self.joints) <= set(indices):
                rows += [[row[indices.index(i)] for i in self.joints] for row in starts]
        return np.array(rows)


@dataclass(frozen=True, eq=False)
class ChainStarts:
    """Starts of Newton's method for a chain of joints, see `newton.StartSource`.

    `pose`: known values -> T, R by columns; `order` and `signs`: the joint that stands for each unknown.
    """

    search: ChainSearch
    pose: ca.Function
    order: np.ndarray
    signs: np.ndarray

    def wanted(self, z: np.ndarray) -> np.ndarray:
        q = np.empty_like(z.T)
        q[:, self.order] = z.T * self.signs
        return ~self.search.within(q)  # NaN too

    def guesses(self, a: np.ndarray) -> np.ndarray:
        T, R = map_columns(self.pose, [a])
        R = R.T.reshape(-1, 3, 3).transpose(0, 2, 1)
        u, _, vt = np.linalg.svd(R)  # the nearest rotation: a matrix with six digits is accepted
        q = self.search.solve(T.T.copy(), u @ vt)
        # round-off of a search depends on the number of poses; Newton's method from rounded numbers does not
        return (np.round(q, DECIMALS)[:, self.order] * self.signs).T.copy()


def known_chain(
    flat: FlatModel, alias: AliasResult, known: Sequence[int], forward: Forward, fold: ca.SX | None
) -> KnownChain | None:
    """Return the serial chain whose pose is known; None if there is none. Cached for parameters that are numbers.

    flat: the model before its known rotations are rewritten; alias: the aliases of the rewritten one. forward: returns
    the plan of the causality from known variables, by index, to targets. fold: values of the parameters.
    """
    if fold is None or not fold.is_constant():
        return _known_chain(flat, alias, known, forward)
    key = "known chain", frozenset(known), frozenset(alias.removed), tuple(ca.DM(fold).elements())
    if key not in flat.cache:
        flat.cache[key] = _known_chain(flat, alias, known, forward)
    return flat.cache[key]


def _known_chain(flat: FlatModel, alias: AliasResult, known: Sequence[int], forward: Forward) -> KnownChain | None:
    if not flat.rotations:
        return None
    fixed = degrees_of_freedom(flat, known)
    pose = fixed.pose()
    if pose is None or not fixed.is_open:
        return None
    positions, rotations = pose
    oriented, joints = set(rotations) <= set(known), fixed.joints
    places = [alias.resolve(i, 0) for i in joints]
    plan = _explicit(forward, joints, [(i, 0) for i in (*positions, *rotations)])
    if plan is None or any(order for _, _, order in places):
        return None
    u = ca.vertcat(*[flat.scope.symbol(i, 0) for i in joints])
    assigned = [a for b in plan.blocks for a in b.assignments]
    targets = [ca.vertcat(*[plan.symbol(i, 0) for i in indices]) for indices in (positions, rotations)]
    _, (T, R) = ca.substitute_inplace([s for s, _ in assigned], [e for _, e in assigned], targets)
    if flat.parameters:
        T, R = ca.substitute([T, R], [flat.p], [plan.parameters])
    if {s.element_hash() for s in ca.symvar(ca.vertcat(T, R))} - {s.element_hash() for s in ca.vertsplit(u)}:
        return None  # it depends on parameters that are symbols, or on time
    R = ca.reshape(R, 3, 3).T
    chain = Chain.of_function(ca.Function("pose", [u], [T, R], {"cse": True}))
    at = None if chain is None else _known_position(chain, positions, known, flat)
    if chain is None or at is None:
        return None
    symbols = [sign * flat.scope.symbol(i, 0) for sign, i, _ in places]
    reached = ca.substitute(ca.vertcat(T, ca.vec(R)), u, ca.vertcat(*symbols))
    turned = ca.reshape(ca.vertcat(*[flat.scope.symbol(i, 0) for i in rotations]), 3, 3).T if oriented else None
    closures = reached - ca.vertcat(at, ca.vec(turned)) if turned is not None else reached[:3] - at
    place = [k for k, i in enumerate((*positions, *rotations)) if i in set(known)]
    given = [((*positions, *rotations)[k], 0) for k in place]
    free = [k for k, i in enumerate(joints) if i not in fixed.locked]
    shorter = _between(chain, free, symbols, at, turned)
    if shorter is None:
        return None
    kept, locked = (
        [(float(sign), (i, 0)) for k, (sign, i, _) in enumerate(places) if (k in free) is within]
        for within in (True, False)
    )
    return KnownChain(
        flat, shorter[0], [joints[k] for k in free], kept, *shorter[1:], closures, given, place, locked, chain, free
    )


def _between(
    chain: Chain, free: list[int], q: Sequence[ca.SX], T: ca.SX, R: ca.SX | None
) -> tuple[Chain, ca.SX, ca.SX | None] | None:
    """Return the chain of the joints `free`, and the pose that it must reach, for known coordinates q of all others;
    None if these are not at its ends, or at the far end without a known rotation."""
    if len(free) == len(chain):
        return chain, T, R
    first, last = free[0], free[-1] + 1
    if len(free) < last - first or (R is None and last < len(chain)):
        return None

    def back(k: int, p: ca.SX) -> ca.SX:
        """The point p before the motion of joint k."""
        h, o = ca.SX(chain.axes[k]), ca.SX(chain.points[k])
        if not chain.revolute[k]:
            return p - h * q[k]
        w = p - o
        return o + w * ca.cos(q[k]) - ca.cross(h, w) * ca.sin(q[k]) + h * ca.dot(h, w) * (1 - ca.cos(q[k]))

    def turned_back(k: int, directions: ca.SX) -> ca.SX:
        zero = back(k, ca.SX.zeros(3))
        return ca.horzcat(*[back(k, d) - zero for d in ca.horzsplit(directions)])

    for k in range(first):
        T, R = back(k, T), None if R is None else turned_back(k, R)
    if R is not None and last < len(chain):
        origin, frame = ca.SX(chain.T), ca.SX(chain.R)
        for k in reversed(range(last, len(chain))):
            origin, frame = back(k, origin), turned_back(k, frame)
        home = ca.SX(chain.R)
        T, R = T + R @ home.T @ (origin - chain.T), R @ home.T @ frame
    kinds = chain.revolute[first:last]
    return Chain(chain.axes[first:last], chain.points[first:last], kinds, chain.T, chain.R), T, R


def _explicit(forward: Forward, joints: Sequence[int], targets: Sequence[Pair]) -> CausalPlan | None:
    """Return the plan of forward kinematics; None if it does not compute everything explicitly from the joints."""
    try:
        plan = forward(joints, targets)
    except ModelError:
        return None
    explicit = not plan.states and not plan.uses_time and all(b.kind in ("explicit", "linear") for b in plan.blocks)
    return plan if explicit and {i for i, _ in plan.inputs} <= set(joints) else None


def _known_position(chain: Chain, names: Sequence[int], known: Sequence[int], flat: FlatModel) -> ca.SX | None:
    """Return the known position; a coordinate that is not known must be one that the joints do not change."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (TRIALS, len(chain)))
    T = chain.pose(q)[0]
    entries = []
    for k, i in enumerate(names):
        if i in known:
            entries.append(flat.scope.symbol(i, 0))
        elif np.ptp(T[:, k]) <= CONSTANT * max(1.0, chain.size):
            entries.append(ca.SX(float(chain.T[k])))
        else:
            return None
    return ca.vertcat(*entries)


def _label(label: str, names: Sequence[str]) -> str:
    """Return the label of a margin with the name of the joint's variable, for q[k]."""
    for k, name in enumerate(names):
        if label.startswith(f"q[{k}]"):
            return name + label.removeprefix(f"q[{k}]")
    return label


def _turned(q: ca.SX, low: float, high: float) -> ca.SX:
    """Return the angle q, in (-pi, pi], with the full turns that bring it nearest to the middle of the limits, or
    inside the only one."""
    if np.isfinite(low) and np.isfinite(high):
        middle = (low + high) / 2
        return nearest_turn(q, middle)
    if np.isfinite(low):
        return q if low <= -np.pi else q + 2 * np.pi * ca.fmax(0.0, ca.ceil((low - q) / (2 * np.pi)))
    if np.isfinite(high):
        return q if high >= np.pi else q - 2 * np.pi * ca.fmax(0.0, ca.ceil((q - high) / (2 * np.pi)))
    return q
