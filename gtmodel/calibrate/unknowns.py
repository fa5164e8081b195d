"""Parameters of a calibration: free, tied to others, fixed, or quaternions of unit length; and their values as
modifiers of a model."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from .._near import meant
from ..compiler.flat import FlatModel
from ..geometry.quaternions import turned
from ..inference import Prior
from ..lang.source import ModelError
from .options import Choice

# expected error of a parameter before calibration by unit: 1 mm, and its angle at a distance of 1 m
SIZE = 1e-3
OTHER_SIZES = {"m/N": 1e-6, "m/s": 1e-3 / 3600, "m/K": 1e-4}  # 1 mm at 1000 N, in an hour, at 10 K
TURN = " turned about "


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Scalar unknowns x (n,) with names, units, start values and sizes, and the parameters as expressions of x.

    `stated`: names whose sizes are stated.

    `moved`: symbols of parameters -> expressions in x, or numbers if they do not depend on x.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    x: ca.SX
    start: np.ndarray
    sizes: np.ndarray
    moved: tuple[tuple[ca.SX, ca.SX], ...]
    priors: tuple[Prior, ...]
    notes: tuple[str, ...] = ()
    stated: frozenset[str] = frozenset()

    @cached_property
    def numbers(self) -> ca.Function:
        """Function of x that returns the values of `moved` as a column."""
        return ca.Function("parameters", [self.x], [ca.vertcat(*[v for _, v in self.moved])])

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Parameter names of `moved`."""
        return tuple(s.name() for s, _ in self.moved)

    def named(self, x: np.ndarray) -> dict[str, float]:
        """Return the values x (n,) by name."""
        return dict(zip(self.names, x.tolist(), strict=True))

    def substituted(self, expressions: Sequence[ca.SX]) -> list[ca.SX]:
        """Return expressions in the parameters as expressions in x."""
        old, new = ca.vertcat(*[s for s, _ in self.moved]), ca.vertcat(*[v for _, v in self.moved])
        return ca.substitute(list(expressions), [old], [new])


@dataclass(frozen=True, eq=False)
class Parameters:
    """Scalar parameters of a problem, of model and measurement: names, symbols, values, units."""

    title: str
    names: list[str] = field(default_factory=list)
    symbols: list[ca.SX] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    units: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, flat: FlatModel, touched: Sequence[int]) -> Parameters:
        parameters = cls(flat.title)
        for q in (flat.parameters[k] for k in touched):
            parameters.add(q.name, q.unit or "", q.value, q.symbol)
        return parameters

    def add(self, name: str, unit: str, value: float, symbol: ca.SX | None = None) -> ca.SX:
        """Add a parameter and return its symbol."""
        self.names.append(name)
        self.units.append(unit)
        self.values.append(float(value))
        self.symbols.append(ca.SX.sym(name) if symbol is None else symbol)
        return self.symbols[-1]

    def extend(self, other: Parameters) -> None:
        """Add all parameters of `other`."""
        for name, unit, value, symbol in zip(other.names, other.units, other.values, other.symbols, strict=True):
            self.add(name, unit, value, symbol)

    def indices(self, name: str) -> list[int]:
        """Indices of a scalar, or of all components of a name. Raises ModelError if there are none."""
        if name in self.names:
            return [self.names.index(name)]
        begin = name[:-1] + "," if name.endswith("]") else name + "["
        components = [k for k, n in enumerate(self.names) if n.startswith(begin)]
        if not components:
            whole = list(dict.fromkeys([*(n.partition("[")[0] for n in self.names), *self.names]))
            hint = meant(name, whole, f"they contain {', '.join(whole[:12])}", most=3)
            raise ModelError(f"the closure equations of {self.title} contain no parameter '{name}'; {hint}")
        return components


def unknowns(parameters: Parameters, choice: Choice) -> Unknowns:
    """Return the unknowns of a choice. Raises ModelError for unknown names and contradictory choices."""
    p = parameters
    free, follows, quaternions = _free(p, choice), _ties(p, choice.tied), _quaternions(p, choice)
    missing = [p.names[k] for k in sorted(free) if not np.isfinite(p.values[k]) and k not in follows]
    if missing:
        raise ModelError(f"parameter '{missing[0]}' of {p.title} has no value; give it a start value")
    chosen = _Chosen(p.title)
    in_quaternions = {k for indices in quaternions.values() for k in indices}
    for k in sorted(free - set(follows) - in_quaternions):
        chosen.moved[k] = chosen.add(p.names[k], p.units[k], p.values[k])
    fixed = {name for name in choice.fixed if TURN in name}
    for name, indices in quaternions.items():
        if set(indices) <= free:
            _turn(p, name, indices, fixed, chosen)
            fixed -= {f"{name}{TURN}{axis}" for axis in "xyz"}
    if fixed:
        raise ModelError(f"'{min(fixed)}' is fixed, but '{min(fixed).split(TURN)[0]}' is not listed in unit; add it")
    for k, target in follows.items():
        chosen.moved[k] = chosen.moved.get(target, ca.SX(p.values[target]))
    everything = [(p.symbols[k], chosen.moved.get(k, ca.SX(p.values[k]))) for k in range(len(p.names))]
    if not chosen.names and (choice.free is None or len(choice.free)):
        raise ModelError(f"no parameter of {p.title} is free: all are fixed or tied; free at least one")
    sizes, stated = _sizes(p, choice, chosen)
    return Unknowns(
        tuple(chosen.names), tuple(chosen.units), ca.vertcat(*chosen.symbols), np.array(chosen.values),
        np.array([sizes[n] for n in chosen.names]), tuple(everything), tuple(choice.priors), tuple(chosen.notes),
        stated,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Chosen(Parameters):
    """Unknowns collected so far, at their start values; `moved`: parameter index -> its expression."""

    moved: dict[int, ca.SX] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def _free(p: Parameters, choice: Choice) -> set[int]:
    free = {k for name in choice.free for k in p.indices(name)} if choice.free is not None else set(range(len(p.names)))
    return free - {k for name in choice.fixed if TURN not in name for k in p.indices(name)}


def _quaternions(p: Parameters, choice: Choice) -> dict[str, list[int]]:
    quaternions = {name: p.indices(name) for name in choice.unit}
    for name, indices in quaternions.items():
        if len(indices) != 4:
            raise ModelError(f"unit names '{name}' with {len(indices)} numbers; a quaternion has four, scalar first")
    return quaternions


def _turn(p: Parameters, name: str, indices: list[int], fixed: set[str], chosen: _Chosen) -> None:
    """Express the quaternion as its start value rotated by three small angles, except those in `still`."""
    reference = np.array([p.values[k] for k in indices])
    length = float(np.linalg.norm(reference))
    if not length > 0:
        raise ModelError(f"the quaternion '{name}' is zero; give it a start value")
    if abs(length - 1) > 1e-6:
        chosen.notes.append(f"the start value of {name} was normalised: its length was {length:.4f}")
    axes = [f"{name}{TURN}{axis}" for axis in "xyz"]
    turn = [ca.SX(0) if axis in fixed else chosen.add(axis, "rad", 0.0) for axis in axes]
    direction = ca.SX(ca.DM(reference / length))
    for k, component in zip(indices, ca.vertsplit(turned(direction, ca.vertcat(*turn))), strict=True):
        chosen.moved[k] = component


def _sizes(p: Parameters, choice: Choice, chosen: _Chosen) -> tuple[dict[str, float], frozenset[str]]:
    """Expected errors by name, and the names of stated ones. Raises ModelError for one that is not positive, and for
    priors on parameters that are not free."""
    stated: set[str] = set()
    sizes = {n: OTHER_SIZES.get(unit, SIZE) for n, unit in zip(chosen.names, chosen.units, strict=True)}
    for name, size in choice.sizes.items():
        if not size > 0:
            raise ModelError(f"the expected error of '{name}' is {size:g}; it must be positive")
        hits = [name] if name in sizes else [p.names[k] for k in p.indices(name)]
        sizes.update({n: size for n in hits if n in sizes})
        stated.update(hits)
    for prior in choice.priors:
        if prior.name not in sizes:
            raise ModelError(f"a prior names '{prior.name}', which is not free; free are: {', '.join(chosen.names)}")
    return sizes, frozenset(stated)


def _ties(p: Parameters, tied: Mapping[str, str]) -> dict[int, int]:
    """Map the index of each tied parameter to the end of its chain."""
    follows: dict[int, int] = {}
    for name, other in tied.items():
        mine, theirs = p.indices(name), p.indices(other)
        if len(mine) != len(theirs):
            raise ModelError(
                f"'{name}' with {len(mine)} numbers is tied to '{other}' with {len(theirs)}; give equal shapes"
            )
        for k, other_k in zip(mine, theirs, strict=True):
            units = [p.units[j] or "1" for j in (k, other_k)]
            if units[0] != units[1]:
                pair = f"'{p.names[k]}' in {units[0]} is tied to '{p.names[other_k]}' in {units[1]}"
                raise ModelError(f"{pair}; tie only parameters of the same unit")
        follows.update(zip(mine, theirs, strict=True))
    for k in follows:
        visited, end = {k}, follows[k]
        while end in follows:
            if end in visited:
                raise ModelError(f"'{p.names[k]}' is tied to itself in a circle; free one of these parameters")
            visited.add(end)
            end = follows[end]
        follows[k] = end
    return follows


_STEP = re.compile(r"(\w+)(?:\[(\d+)\])?")


def modifiers(flat: FlatModel, values: Mapping[str, float], touched: Sequence[int]) -> dict[str, Any]:
    """Return whole parameters for type(model)(**modifiers): arrays and numbers by name.

    Parameters of parts are in dictionaries, those of indexed parts in a list of dictionaries. `values` by scalar name;
    `touched`: indices in flat.parameters of the parameters to return.
    """
    p = ca.vertcat(*[q.symbol for q in flat.parameters])
    numbers = np.array([values.get(q.name, q.value) for q in flat.parameters])
    nested: dict[str, Any] = {}
    for name in dict.fromkeys(_whole(flat.parameters[k].name) for k in touched):
        if name not in flat.bindings:
            continue
        array = np.asarray(ca.Function("p", [p], [flat.bindings[name]])(numbers))
        shape = _shape(name, [q.name for q in flat.parameters])
        *path, last = name.split(".")
        inside = nested
        for step, index in (_STEP.fullmatch(s).groups() for s in path):  # type: ignore[union-attr]
            if index is None:
                inside = inside.setdefault(step, {})
            else:
                parts = inside.setdefault(step, [])
                parts += [{} for _ in range(int(index) + 1 - len(parts))]
                inside = parts[int(index)]
        inside[last] = array.reshape(-1).reshape(shape) if shape else float(array.reshape(-1)[0])
    return nested


def merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Modifiers `old` updated by `new`; one dictionary for several parts is copied to each."""
    result = dict(old)
    for name, value in new.items():
        before = old.get(name)
        if isinstance(value, Mapping) and isinstance(before, Mapping):
            result[name] = merged(before, value)
        elif isinstance(value, list) and value and isinstance(value[0], Mapping) and isinstance(before, Mapping | list):
            each = before if isinstance(before, list) else [before] * len(value)
            pairs = zip(each, value, strict=False)
            result[name] = [merged(a, b) for a, b in pairs] if len(each) == len(value) else value
        elif isinstance(value, Mapping) and isinstance(before, list):
            result[name] = [merged(a, value) for a in before]
        else:
            result[name] = value
    return result


def _whole(name: str) -> str:
    """Name of the whole parameter: leg[0].c[1,2] -> leg[0].c."""
    head, dot, last = name.rpartition(".")
    return head + dot + last.partition("[")[0]


def _shape(name: str, names: Sequence[str]) -> tuple[int, ...]:
    indices = [n[len(name) + 1 : -1].split(",") for n in names if n.startswith(f"{name}[") and n.endswith("]")]
    return tuple(int(k) + 1 for k in np.max(np.array(indices, int), axis=0)) if indices else ()
