"""Closed forms of serial chains: joint coordinates from the pose of a frame, with named branches.

A block that Newton's method would solve may be the inverse kinematics of a chain of joints. The forward kinematics, a
causality of its own, shows it: if it is a product of exponentials, `geometry.chains` finds a closed form from the axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ..geometry.chains import Chain, ClosedForm, closed_form
from ..lang.source import ModelError
from .alias import AliasResult
from .blocks import Margin, Root, SolvedBlock
from .flat import FlatModel
from .known_poses import freedoms_of

if TYPE_CHECKING:
    from .plan import CausalPlan

Pair = tuple[int, int]
Forward = Callable[[Sequence[int], Sequence[Pair]], "CausalPlan"]

# a known coordinate may be missing if the joints do not change it, relative to the size of the chain
CLOSED = "closed form"  # kind of the block
CONSTANT = 1e-12
TRIALS = 4


@dataclass(frozen=True, eq=False)
class SolvedChain:
    """A chain of joints, solved in closed form by `block`: the symbols of its joints, and the known symbols it reads."""

    joints: list[Pair]
    read: list[Pair]
    block: SolvedBlock
    form: ClosedForm


def solved_chain(flat: FlatModel, alias: AliasResult, known: Sequence[int], forward: Forward) -> SolvedChain | None:
    """Return the chain whose pose is known, solved in closed form; None if there is no such chain or no closed form.

    flat: the model before its known rotations are rewritten; alias: the aliases of the rewritten one. forward: returns
    the plan of the causality from known variables, by index, to targets.
    """
    freedoms = freedoms_of(flat, known)
    pose = freedoms.pose()
    if pose is None or not freedoms.joints:
        return None
    T_names, R_names = pose
    oriented = set(R_names) <= set(known)
    joints = freedoms.joints
    plan = _explicit(forward, joints, [(i, 0) for i in (*T_names, *R_names)])
    if plan is None:
        return None
    u = ca.vertcat(*[flat.scope.symbol(i, 0) for i in joints])
    assigned = [a for b in plan.blocks for a in b.assignments]
    targets = [ca.vertcat(*[plan.symbol(i, 0) for i in T_names]), ca.vertcat(*[plan.symbol(i, 0) for i in R_names])]
    targets = [ca.substitute(t, flat.p, plan.parameters) if flat.parameters else t for t in targets]
    _, (T, R) = ca.substitute_inplace([s for s, _ in assigned], [e for _, e in assigned], targets)
    if {s.element_hash() for s in ca.symvar(ca.vertcat(T, R))} - {s.element_hash() for s in ca.vertsplit(u)}:
        return None  # it depends on parameters that are symbols, or on time
    R = ca.reshape(R, 3, 3).T
    chain = Chain.of_function(ca.Function("pose", [u], [T, R], {"cse": True}))
    form = None if chain is None else closed_form(chain, oriented=oriented)
    if chain is None or form is None:
        return None
    at = _known_position(chain, T_names, known, flat)
    if at is None:
        return None
    R_known = ca.reshape(ca.vertcat(*[flat.scope.symbol(i, 0) for i in R_names]), 3, 3).T if oriented else None
    places = [alias.resolve(i, 0) for i in joints]
    if any(order for _, _, order in places):
        return None
    values = [float(s) * flat.scope.symbol(kept, 0) for s, kept, _ in places]
    block = _block(flat, form, places, joints, values, at, R_known, ca.vertcat(T, ca.vec(R)), u)
    read = [(i, 0) for i in (*T_names, *(R_names if oriented else ())) if i in known]
    return SolvedChain([(kept, 0) for _, kept, _ in places], read, block, form)


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


def _block(
    flat: FlatModel,
    form: ClosedForm,
    places: Sequence[tuple[int, int, int]],
    joints: Sequence[int],
    values: Sequence[ca.SX],
    T: ca.SX,
    R: ca.SX | None,
    pose: ca.SX,
    u: ca.SX,
) -> SolvedBlock:
    signs = [ca.SX.sym(b.name) for b in form.branches]
    expressions = form.expressions(T, R, signs)
    names = [flat.variables[i].name for i in joints]
    margins = [Margin(kind, e, _label(label, names)) for kind, e, label in expressions.margins]
    assignments = []
    for (sign, kept, _), q, i, turns in zip(places, expressions.q, joints, form.chain.revolute, strict=True):
        v = flat.variables[i]
        value = _turned(q, v.min, v.max) if turns else q
        assignments.append((flat.scope.symbol(kept, 0), float(sign) * value))
        margins += [
            Margin("limit", m, f"{v.name}, {v.min:.4g} to {v.max:.4g} {v.unit or ''}".rstrip())
            for m in (value - v.min if np.isfinite(v.min) else None, v.max - value if np.isfinite(v.max) else None)
            if m is not None
        ]
    slopes = form.slopes(ca.vertcat(*values))
    roots = [
        Root(sign, slope, f"{b.name}, {b.words[0]} (+) or {b.words[1]} (-)", name=b.name)
        for sign, slope, b in zip(signs, slopes, form.branches, strict=True)
    ]
    kept = [s for s, _ in assignments]
    reached = ca.substitute(pose, u, ca.vertcat(*values))
    given = ca.vertcat(T, ca.vec(R)) if R is not None else T
    closures = tuple(ca.vertsplit(reached[: given.numel()] - given))
    equations = [f"the pose of the chain of {', '.join(names)}"]
    named = [s.name() for s in kept]
    return SolvedBlock(CLOSED, named, equations, assignments, margins, roots, form.structure, closures=closures)


def _label(label: str, names: Sequence[str]) -> str:
    """Return the label of a margin with the name of the joint's variable, for q[k]."""
    for k, name in enumerate(names):
        if label.startswith(f"q[{k}]"):
            return name + label.removeprefix(f"q[{k}]")
    return label


def _turned(q: ca.SX, low: float, high: float) -> ca.SX:
    """Return the angle q, in (-pi, pi], with the full turns that bring it nearest to the middle of the limits."""
    middle = (low + high) / 2
    if not np.isfinite(middle) or middle == 0.0:
        return q
    return q + 2 * np.pi * ca.floor((middle - q) / (2 * np.pi) + 0.5)
