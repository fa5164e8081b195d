"""CausalFunction: one causality as a function on numbers, with a status beside its values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ..lang.model import Model
from ..lang.scope import derivative_name
from ..lang.source import ModelError
from ..results.status import Status
from .emit import express
from .explain import explain
from .flat import FlatModel, flatten
from .plan import Plan, make_plan

# a pivot below this fraction of its typical size means singular: values would carry errors of 1e-16/1e-9
PIVOT_TOLERANCE = 1e-9

Pair = tuple[int, int]


@dataclass(frozen=True)
class Signal:
    """A named input or output: shape () or (n,), unit, and the scalar chain symbols it is made of."""

    name: str
    shape: tuple[int, ...]
    unit: str
    pairs: tuple[Pair, ...]

    @property
    def size(self) -> int:
        return len(self.pairs)


class CausalFunction:
    """values + status for a choice of known variables and targets.

    Call it with one argument per entry of `inputs` (states first, then the known variables and their
    derivatives as far as needed), each of the signal's shape or with a leading row axis (n, ...). It returns
    one array per target, then the status: a `Status` for a single call, an int array (n,) of Status codes for
    rows. It never throws on data: a row without a solution is NaN with a status that says why.
    """

    def __init__(self, plan: Plan, inputs: list[Signal], outputs: list[Signal], name: str) -> None:
        self.plan = plan
        self.flat = plan.flat
        self.inputs = inputs
        self.outputs = outputs
        self.name = name
        self.margins = [m for b in plan.blocks for m in b.margins]

    def _build(self, parameters: ca.SX | None) -> ca.Function:
        """parameters None: kept as a last input; else folded in as numbers."""
        flat = self.flat
        args = [ca.vertcat(*[flat.scope.symbol(*p) for p in s.pairs]) for s in self.inputs]
        out = [ca.vertcat(*[self.plan.symbol(*p) for p in s.pairs]) for s in self.outputs]
        margins = ca.vertcat(*[m.expression for m in self.margins]) if self.margins else ca.SX(0, 1)
        results = express(self.plan, [*out, margins], parameters)
        names_in = [c_name(s.name) for s in self.inputs]
        names_out = [c_name(s.name) for s in self.outputs] + ["margins"]
        if self.plan.uses_time:
            args.append(flat.scope.time)
            names_in.append("time")
        if parameters is None:
            args.append(flat.p)
            names_in.append("parameters")
        names_out = [f"out_{n}" if n in names_in else n for n in names_out]
        return ca.Function(c_name(self.name), args, results, names_in, names_out)

    @cached_property
    def casadi(self) -> ca.Function:
        """ca.Function (inputs...) -> (targets..., margins), parameters folded in as numbers."""
        return self._build(ca.SX(ca.DM(self.flat.require_values())))

    @cached_property
    def casadi_parametric(self) -> ca.Function:
        """ca.Function (inputs..., parameters) -> (targets..., margins)."""
        return self._build(None)

    @property
    def parameter_names(self) -> list[str]:
        """Names of the entries of the parameter vector."""
        return [q.name for q in self.flat.parameters]

    @cached_property
    def _jacobian(self) -> ca.Function:
        f = self.casadi
        args = f.sx_in()
        res = f.call(args)
        n = len(self.outputs)
        x = ca.vertcat(*args)
        full = ca.jacobian(ca.vertcat(*res[:n]), x)
        return ca.Function(f"jac_{f.name()}", args, [ca.densify(full), res[-1]])

    def __call__(self, *arguments: Any) -> Any:
        """Values of the targets, then the status. Raises TypeError for a wrong number or shape of arguments."""
        columns, rows = self._columns(arguments)
        results = self._evaluate(self.casadi, columns)
        values = [r.T for r in results[:-1]]
        status = self.status(columns, results)
        for v in values:
            v[status != Status.OK] = np.nan
        shaped = [v.reshape(v.shape[0], *s.shape) for v, s in zip(values, self.outputs, strict=True)]
        if rows is None:
            return (*(v[0] if s.shape else float(v[0]) for v, s in zip(shaped, self.outputs, strict=True)),
                    Status(int(status[0])))  # fmt: skip
        return (*shaped, status)

    def jacobian(self, *arguments: Any) -> tuple[np.ndarray, Any]:
        """d targets / d inputs, (outputs, inputs) or (n, outputs, inputs), and the status."""
        columns, rows = self._columns(arguments)
        n = columns[0].shape[1] if columns else 1
        full, margins = self._evaluate(self._jacobian, columns)
        total_in = sum(c.shape[0] for c in columns)
        # CasADi maps matrices side by side: (outputs, n * inputs)
        full = full.reshape(full.shape[0], n, total_in).transpose(1, 0, 2).copy()
        status = self.status(columns, [full.reshape(n, -1).T, margins])
        full[status != Status.OK] = np.nan
        return (full[0], Status(int(status[0]))) if rows is None else (full, status)

    def _evaluate(self, f: ca.Function, columns: list[np.ndarray]) -> list[np.ndarray]:
        n = columns[0].shape[1] if columns else 1
        g = f if n == 1 else f.map(n)
        return [np.array(r.full()) for r in g.call([ca.DM(c) for c in columns])]

    def status(self, columns: list[np.ndarray], results: list[np.ndarray]) -> np.ndarray:
        """Status code of each evaluated column from inputs, margins and outputs; the first cause wins."""
        n = results[-1].shape[1]
        code = np.zeros(n, dtype=int)
        margins = results[-1]
        for m, row in zip(self.margins, margins, strict=True):
            with np.errstate(invalid="ignore"):
                if m.kind == "discriminant":
                    bad, verdict = ~(row >= 0), Status.OUT_OF_RANGE
                else:
                    bad, verdict = ~(np.abs(row) > PIVOT_TOLERANCE * m.scale), Status.SINGULAR
            code = np.where((code == 0) & bad, verdict, code)
        finite = np.all([np.all(np.isfinite(r), axis=0) for r in results[:-1]], axis=0)
        code = np.where((code == 0) & ~finite, Status.NOT_FINITE, code)
        inputs = np.all([np.all(np.isfinite(c), axis=0) for c in columns], axis=0) if columns else True
        return np.where(inputs, code, Status.NOT_FINITE)

    def diagnose(self, *arguments: Any) -> str:
        """One sentence on a single call: ok, or which root or pivot failed and by how much."""
        columns, _ = self._columns(arguments)
        results = self._evaluate(self.casadi, columns)
        status = Status(int(self.status(columns, results)[0]))
        for m, row in zip(self.margins, results[-1], strict=True):
            value = float(row[0])
            if m.kind == "discriminant" and not value >= 0:
                return f"{status.sentence}: the root for {m.label} has the negative discriminant {value:.4g}"
            if m.kind == "pivot" and not abs(value) > PIVOT_TOLERANCE * m.scale:
                return f"{status.sentence}: the pivot for {m.label} is {value:.4g}, typically {m.scale:.4g}"
        return status.sentence

    def _columns(self, arguments: Sequence[Any]) -> tuple[list[np.ndarray], int | None]:
        wanted = [(s.name, s.shape) for s in self.inputs]
        if self.plan.uses_time:
            wanted.append(("time", ()))
        if len(arguments) != len(wanted):
            names = ", ".join(n for n, _ in wanted)
            raise TypeError(f"{self.name} takes {len(wanted)} arguments ({names}); found {len(arguments)}")
        rows: int | None = None
        arrays = []
        for (name, shape), value in zip(wanted, arguments, strict=True):
            a = np.asarray(value, dtype=float)
            if a.ndim == len(shape) + 1 and a.shape[1:] == shape:
                if rows is not None and rows != a.shape[0]:
                    raise TypeError(f"{self.name}: '{name}' has {a.shape[0]} rows, another argument {rows}")
                rows = a.shape[0]
            elif a.shape != shape:
                raise TypeError(f"{self.name}: '{name}' takes shape {shape} or (n, ...); found {a.shape}")
            arrays.append((a, shape))
        n = 1 if rows is None else rows
        columns = []
        for a, shape in arrays:
            size = int(np.prod(shape, dtype=int))
            flat = a.reshape(-1, size) if a.ndim > len(shape) else np.broadcast_to(a.reshape(1, size), (n, size))
            columns.append(np.ascontiguousarray(flat.T))
        return columns, rows

    def explain(self) -> str:
        """The certificate in text: blocks, sizes, branch signs, assumptions, file:line."""
        return explain(self)

    def __repr__(self) -> str:
        return f"CausalFunction({', '.join(s.name for s in self.inputs)} -> {', '.join(s.name for s in self.outputs)})"


def c_name(name: str) -> str:
    """A name as a C identifier: der(T,2) -> d2_T, arm[0].rod -> arm_0_rod."""
    order = 0
    while name.startswith("der("):
        inner = name[4:-1]
        base, comma, k = inner.rpartition(",")
        name, order = (base, order + int(k)) if comma and k.strip().isdigit() else (inner, order + 1)
    text = "".join(c if c.isalnum() else "_" for c in name).strip("_")
    while "__" in text:
        text = text.replace("__", "_")
    prefix = "" if order == 0 else ("d_" if order == 1 else f"d{order}_")
    return prefix + text


def compile_causal(
    model: Model | FlatModel,
    known: str | Sequence[str] = (),
    targets: str | Sequence[str] = (),
    prefer: str | Sequence[str] = (),
    branches: Mapping[str, int] | None = None,
    name: str | None = None,
) -> CausalFunction:
    """The function that computes `targets` when `known` is prescribed.

    Args:
        known: names of variables prescribed with all their derivatives.
        targets: names such as "T", "der(q)", "der(T,2)", "arm[0].rod.tension".
        prefer: names to keep as states.
        branches: sign +1 or -1 by declared branch name.

    Raises ModelError with file and line of the equations concerned.
    """
    flat = model if isinstance(model, FlatModel) else flat_of(model)
    known, targets, prefer = (list([x] if isinstance(x, str) else x) for x in (known, targets, prefer))
    key = (tuple(known), tuple(targets), tuple(prefer), tuple(sorted((branches or {}).items())), name)
    if key not in flat.cache:
        flat.cache[key] = _compile(flat, known, targets, prefer, branches, name)
    return flat.cache[key]


def _compile(
    flat: FlatModel,
    known: list[str],
    targets: list[str],
    prefer: list[str],
    branches: Mapping[str, int] | None,
    name: str | None,
) -> CausalFunction:
    if not targets:
        raise ModelError(f"{flat.title}: no target is given; name at least one variable to compute")
    groups = []
    for text in known:
        shape, indices, order = flat.lookup(text)
        if order:
            raise ModelError(f"'{text}' cannot be known without '{flat.variables[indices[0]].name}' itself")
        groups.append((text, shape, indices))
    indices = [i for _, _, g in groups for i in g]
    if len(set(indices)) != len(indices):
        raise ModelError(f"{flat.title}: a known variable is named twice in {', '.join(known)}")
    outputs = []
    for text in targets:
        shape, group, order = flat.lookup(text)
        base = text if not text.startswith("der(") else _base(flat, group, shape)
        outputs.append(
            Signal(derivative_name(base, order), shape, _unit(flat, group[0], order), tuple((i, order) for i in group))
        )
    preferred = [i for text in prefer for i in flat.lookup(text)[1]]
    pairs = [p for s in outputs for p in s.pairs]
    plan = make_plan(flat, indices, pairs, preferred, branches)
    return CausalFunction(plan, input_signals(plan, groups), outputs, name or _function_name(outputs, groups))


def flat_of(model: Model) -> FlatModel:
    """The flattened model; made once per configuration object."""
    cached = model.__dict__.get("_flat")
    if cached is None:
        cached = flatten(model)
        model.__dict__["_flat"] = cached
    return cached


def input_signals(plan: Plan, groups: list[tuple[str, tuple[int, ...], list[int]]]) -> list[Signal]:
    """States first, then the known variables with their derivatives as far as anything reads them."""
    flat = plan.flat
    known = {i for _, _, g in groups for i in g}
    signals: list[Signal] = []
    for order, name, shape, indices in _state_groups(plan, [p for p in plan.inputs if p[0] not in known]):
        signals.append(
            Signal(
                derivative_name(name, order), shape, _unit(flat, indices[0], order), tuple((i, order) for i in indices)
            )
        )
    for name, shape, indices in groups:
        top = max([order for i, order in plan.inputs if i in indices], default=-1)
        for order in range(top + 1):
            signals.append(
                Signal(
                    derivative_name(name, order),
                    shape,
                    _unit(flat, indices[0], order),
                    tuple((i, order) for i in indices),
                )
            )
    return signals


def _state_groups(plan: Plan, states: list[Pair]) -> list[tuple[int, str, tuple[int, ...], list[int]]]:
    """State symbols gathered into declared vectors where they are complete."""
    flat = plan.flat
    left = set(states)
    result = []
    for order in sorted({k for _, k in states}):
        for name, (shape, indices) in sorted(flat.groups.items(), key=lambda g: (g[0].count("."), g[1][1][:1])):
            if shape and indices and all((i, order) in left for i in indices):
                result.append((order, name, shape, list(indices)))
                left -= {(i, order) for i in indices}
        for i, k in sorted(left):
            if k == order:
                result.append((order, flat.variables[i].name, (), [i]))
    return result


def _base(flat: FlatModel, group: list[int], shape: tuple[int, ...]) -> str:
    if not shape:
        return flat.variables[group[0]].name
    return next(n for n, (s, g) in flat.groups.items() if g == group and s == shape)


def _unit(flat: FlatModel, index: int, order: int) -> str:
    unit = flat.variables[index].unit
    if unit is None:
        return "?"
    if order == 0:
        return unit
    per = "s" if order == 1 else f"s{order}"
    return f"1/{per}" if unit in ("1", "") else f"{unit}/{per}"


def _function_name(outputs: list[Signal], groups: list[tuple[str, tuple[int, ...], list[int]]]) -> str:
    out = "_".join(c_name(s.name) for s in outputs)
    return f"{out}_from_{'_'.join(c_name(n) for n, _, _ in groups)}" if groups else out
