"""Efforts of any model as a linear function of its parameters, and scalar parameters by the names that users write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from gtmodel.compiler.causal import CausalFunction, c_name, compile_causal, flat_of
from gtmodel.compiler.evaluate import Built, build
from gtmodel.compiler.flat import FlatModel
from gtmodel.compiler.plan import CausalPlan, make_plan
from gtmodel.compiler.rows import PlainMargin, map_columns, status_codes
from gtmodel.inference import negligible
from gtmodel.lang import Model, ModelError
from gtmodel.results import Status

from .._near import meant
from .._pickling import Portable


class ParameterError(ModelError):
    """A parameter cannot be used as requested; `parameter` is its name."""

    def __init__(self, sentence: str, parameter: str = "") -> None:
        super().__init__(sentence)
        self.parameter = parameter


def scalar_parameters(flat: FlatModel, names: Sequence[str]) -> list[int]:
    """Positions in `flat.parameters`; an array's name stands for all its entries, in order.

    Raises ParameterError for an unknown name (with close matches), a name that occurs twice, or a parameter that
    depends on others; ModelError for no name.
    """
    known = [q.name for q in flat.parameters]
    places: list[int] = []
    for name in names:
        matches = [k for k, other in enumerate(known) if other == name or other.startswith(f"{name}[")]
        if not matches:
            raise ParameterError(_unknown(flat, name, known), name)
        twice = sorted(set(matches) & set(places))
        if twice:
            raise ParameterError(f"parameter '{known[twice[0]]}' is named twice; name each once", known[twice[0]])
        places += matches
    if not places:
        raise ModelError(f"{flat.title}: no parameter is named; name at least one, such as '{known[0]}'")
    return places


def among(every: Sequence[str], names: Sequence[str]) -> list[int]:
    """Positions of names among scalar names; an array's name stands for all its entries. Raises ModelError."""
    places: list[int] = []
    for name in names:
        matches = [k for k, other in enumerate(every) if other == name or other.startswith(f"{name}[")]
        if not matches:
            raise ModelError(f"'{name}' is not a parameter of this regressor; it has {', '.join(every)}")
        places += matches
    return sorted(set(places))


def _unknown(flat: FlatModel, name: str, every: list[str]) -> str:
    if name in flat.bindings:
        inside = {s.element_hash() for s in ca.symvar(ca.SX(flat.bindings[name]))}
        origin = [q.name for q in flat.parameters if q.symbol.element_hash() in inside]
        return f"parameter '{name}' of {flat.title} depends on {', '.join(origin) or 'numbers'}; name these instead"
    known = list(dict.fromkeys([*(n.partition("[")[0] for n in every), *every]))
    hint = meant(name, known, f"there are {', '.join(known[:12])}", most=3)
    return f"{flat.title} has no parameter '{name}'; {hint}"


Array = np.ndarray

# relative error of Y p + y0 at random parameters; some thousand operations in double precision
LINEAR = 1e-9
DRAWS, SEED = 4, 0  # random parameter vectors at each sample point of the plan, to test linearity


class RegressorRows(NamedTuple):
    """Rows of a regressor: effort = Y p + y0 at each row, NaN where the status is not OK.

    Y (n, targets, p), y0 (n, targets), status (n,) of int codes of `Status`.
    """

    Y: Array
    y0: Array
    status: Array

    def stacked(self) -> tuple[Array, Array]:
        """Y (n targets, p) and y0 (n targets,), row after row."""
        n, m, p = self.Y.shape
        return self.Y.reshape(n * m, p), self.y0.reshape(n * m)


class Regressor(Portable):
    """Y and y0 with effort = Y p + y0 for a prescribed motion: the exact Jacobian of the causal inverse dynamics.

    `Regressor(robot, ["m_p", "m_c", "coulomb", "viscous"], known="q", targets="tau")` is the regressor of Dressler
    2012, eqs. (6.7) and (6.8), for measured carts. All other parameters keep their values in the model. Called with
    rows in the order of `inputs` (known variables and their derivatives, (n, ...) each), it returns `RegressorRows`.

    Args:
        parameters: names; an array's name stands for all its entries, "m_c[1]" for one.
        known: variables prescribed by the motion.
        targets: measured efforts.
        prefer, branches: as for `Model.causal`.
        idle: whether to allow parameters without effect on the targets; their columns are zero.

    Attributes: names (p,) of the parameters, nominal (p,) their values in the model [SI], units (p,), inputs and
    outputs (signals with name, shape and unit), columns: names of the scalar targets; base: the names that are base
    parameters, only for a `BaseRegressor`; column_units: units of the targets if they differ, else empty.

    Raises ModelError for an unknown parameter, for one without effect, if a target is not linear in a parameter, and if
    the motion does not determine the targets.

    >>> class Axis(gt.Model):  # a cart with viscous and Coulomb friction
    ...     m, d, c = gt.parameter(2.0, unit="kg"), gt.parameter(5.0, unit="kg/s"), gt.parameter(3.0, unit="N")
    ...     q, tau = gt.variable(unit="m"), gt.variable(unit="N")
    ...     def equations(self):
    ...         v = gt.der(self.q)
    ...         yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)
    >>> regressor = gt.identify.Regressor(Axis(), ["m", "d"])
    >>> [signal.name for signal in regressor.inputs]
    ['q', 'der(q)', 'der(q,2)']
    >>> rows = regressor([0.1], [0.5], [4.0])  # one row: position, velocity, acceleration
    >>> rows.Y.tolist(), rows.y0.tolist()  # Coulomb friction keeps its value
    ([[[4.0, 0.5]]], [[3.0]])
    """

    base: tuple[str, ...] = ()

    def __init__(
        self,
        model: Model,
        parameters: Sequence[str],
        known: str | Sequence[str] = "q",
        targets: str | Sequence[str] = "tau",
        prefer: str | Sequence[str] = (),
        branches: Mapping[str, int] | None = None,
        idle: bool = False,
    ) -> None:
        self._idle = idle
        if isinstance(parameters, str):
            parameters = [parameters]
        flat = flat_of(model)
        self._chosen = scalar_parameters(flat, parameters)
        causal = compile_causal(model, known, targets, prefer, branches)
        entries = [flat.parameters[k] for k in self._chosen]
        self.names = tuple(q.name for q in entries)
        self.nominal = np.array([q.value for q in entries])
        self.inputs, self.outputs = causal.inputs, causal.outputs
        self.columns = tuple(n for s in self.outputs for n in _elements(s.name, s.shape))
        by_joint = getattr(model, "joint_unit", lambda _: "")  # only serial arms have it
        self.units = tuple(q.unit or by_joint(q.name) or "?" for q in entries)
        # an arm with revolute and prismatic joints
        mixed = self.outputs[0].unit == "?"
        self.column_units = tuple(by_joint(n) or "?" for n in self.columns) if mixed else ()
        self._title = flat.title
        plan = _partly_folded(causal, self._chosen)
        self._uses_time = plan.uses_time
        self._plan, self._p0 = plan, flat.p0
        self._margins = [PlainMargin(m.kind, m.scale) for m in plan.margins]
        self._sizes = causal.sizes
        self._built = self._build([(c_name(s.name), s.pairs) for s in self.outputs])
        self._kernels = self._built.kernels
        self._function = self._linear_function()

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.names)

    def __call__(self, *rows: Any) -> RegressorRows:
        """Evaluate many rows: one array (n, *shape) per input. Raises TypeError for a wrong number or shape."""
        columns = self._columns(rows)
        n = columns[0].shape[1]
        statuses, zs = np.zeros(n, dtype=int), []
        known = np.vstack([*columns, np.repeat(self._p0[:, None], n, axis=1)]) if self._kernels else np.zeros((0, n))
        for kernel in self._kernels:
            z, converged, singular = kernel.solve(known)
            statuses = np.where((statuses == 0) & ~converged, Status.NOT_CONVERGED, statuses)
            statuses = np.where((statuses == 0) & singular, Status.SINGULAR, statuses)
            zs.append(z)
            known = np.vstack([known, z])
        results = map_columns(self._function, [*columns, *zs])
        status = status_codes(self._margins, columns, results, statuses, sizes=self._sizes)
        m, p = len(self.columns), len(self._chosen)
        Y, y0 = results[0].T.reshape(n, m, p), results[1].T
        bad = status != Status.OK
        Y[bad], y0[bad] = np.nan, np.nan
        return RegressorRows(Y, y0, status)

    def numbers_of(self, values: Mapping[str, float]) -> dict[str, float]:
        """The parameters of this regressor, from values of all parameters of a model."""
        return {n: values[n] for n in self.names if n in values}

    def effort(self, parameters: Any, *rows: Any) -> Array:
        """Efforts (n, targets) of a motion for parameter values (p,)."""
        values = self(*rows)
        return values.Y @ np.asarray(parameters, dtype=float) + values.y0

    @cached_property
    def casadi(self) -> ca.Function:
        """ca.Function (inputs of one row, as columns) -> Y (targets, p), y0 (targets,), status, for an optimisation.

        The numbers are valid only if `status` is 0, a code of `Status`. `.map(n)` takes the rows side by side. Newton
        blocks are solved from the home pose, as in `CausalFunction.casadi`.
        """
        f, m, p = self._function, len(self.columns), len(self._chosen)
        names = [c_name(s.name) for s in self.inputs] + ["time"] * self._uses_time
        kind: Any = ca.MX if self._kernels else ca.SX
        inputs: list[Any] = [kind.sym(n, s.size) for n, s in zip(names, self.inputs, strict=False)]
        inputs += [kind.sym("time")] * self._uses_time
        # the targets are linear in the parameters, so that the status at the model's own parameters is valid for all
        *zs, status, _ = self._status().call([*inputs, ca.DM(self._p0)])
        Y, y0, _ = f.call([*inputs, *zs])
        return ca.Function("regressor", inputs, [ca.reshape(Y, p, m).T, y0, status], names, ["Y", "y0", "status"])

    def _build(self, outputs: list[tuple[str, Any]]) -> Built:
        inputs = [(c_name(s.name), s.pairs) for s in self.inputs]
        return build(self._plan, inputs, outputs, "efforts", parametric=True)

    def _status(self) -> ca.Function:
        """(inputs..., parameters) -> unknowns of each Newton block, status, margins."""
        flat = self._plan.flat
        pairs = [tuple(flat.scope.owner(s) for s in b.unknowns) for b in self._plan.newton]
        return self._build([(f"z{k}", p) for k, p in enumerate(pairs)]).whole

    def _linear_function(self) -> ca.Function:
        """(inputs..., z of each Newton block...) -> Y by rows (targets p,), y0 (targets,), margins."""
        f = self._built.closed
        arguments = f.sx_in()
        results = f.call(arguments)
        place = len(self.inputs) + self._uses_time
        everything, others = arguments[place], [a for k, a in enumerate(arguments) if k != place]
        chosen = ca.vertcat(*[everything[k] for k in self._chosen])
        effort = ca.SX(ca.vertcat(*results[:-1]))
        self._refuse_moving(place)
        jacobian = ca.jacobian(effort, chosen)
        self._refuse_absent(jacobian)
        inside = {s.element_hash() for s in ca.symvar(jacobian)}
        base = np.zeros(self.size)
        if any(s.element_hash() in inside for s in ca.vertsplit(chosen)):
            base = self.nominal  # a division by a parameter may cancel: _try_linear decides
        folded = ca.substitute([jacobian, effort - jacobian @ chosen], [chosen], [ca.DM(base)])
        # geometry: the margins keep the nominal parameters
        margins = ca.substitute([results[-1]], [everything], [ca.DM(self._p0)])
        Y, y0 = (ca.densify(e) for e in folded)
        outputs = ca.cse([ca.vec(Y.T), y0, ca.densify(margins[0])])
        function = ca.Function("regressor", others, outputs)
        self._try_linear(function, ca.Function("effort", [*others, chosen], [effort]))
        return function

    def _refuse_moving(self, place: int) -> None:
        """The motion must not depend on the parameters: no Newton block may read one of them."""
        inputs = sum(s.size for s in self.inputs) + self._uses_time
        for kernel in self._built.kernels:
            z, a = kernel.residual.sx_in()
            residual = kernel.residual.call([z, a])[0]
            which = ca.which_depends(residual, ca.vertcat(*[a[inputs + k] for k in self._chosen]), 1, False)
            if any(which):
                raise self._nonlinear(self.names[which.index(True)])

    def _refuse_absent(self, jacobian: ca.SX) -> None:
        for k, name in enumerate(self.names):
            if not self._idle and jacobian[:, k].nnz() == 0:
                raise ParameterError(
                    f"parameter '{name}' of {self._title} has no effect on {', '.join(s.name for s in self.outputs)} "
                    f"when {', '.join(s.name for s in self.inputs)} are known; leave it out",
                    name,
                )

    def _try_linear(self, function: ca.Function, effort: ca.Function) -> None:
        """Compare efforts at random parameters in the sample points of the plan; raises ParameterError."""
        rng = np.random.default_rng(SEED)
        sizes = np.where(negligible(self.nominal, self.units), 1.0, np.abs(self.nominal))
        columns = self._samples()
        Y, y0, _ = map_columns(function, columns)
        n, m = y0.shape[1], y0.shape[0]
        Y = Y.T.reshape(n, m, self.size)

        def nonlinear(draw: Array, places: Sequence[int]) -> bool:
            p = self.nominal.copy()
            p[list(places)] = draw[list(places)]
            exact = map_columns(effort, [*columns, np.repeat(p[:, None], n, axis=1)])[0].T
            scale = np.max(np.abs(Y) * sizes, axis=2) + np.abs(exact) + np.finfo(float).tiny
            # NaN is not linear either
            return not np.max(np.abs(exact - Y @ p - y0.T) / scale) <= LINEAR

        everything = range(self.size)
        for draw in self.nominal + sizes * rng.uniform(-0.5, 1.0, (DRAWS, self.size)):
            if not nonlinear(draw, everything):
                continue
            single = next((k for k in everything if nonlinear(draw, [k])), None)
            if single is not None:
                raise self._nonlinear(self.names[single])
            pairs = combinations(everything, 2)
            j, k = next((pair for pair in pairs if nonlinear(draw, pair)), (0, self.size - 1))
            raise ParameterError(
                f"{self._efforts()} is linear in parameter '{self.names[j]}' and in '{self.names[k]}', but not in both "
                "together; fix one of them at a number and leave it out of the list",
                self.names[k],
            )

    def _samples(self) -> list[Array]:
        """Inputs and Newton unknowns at the consistent points of the plan, as columns."""
        rows = {pair: n for n, pair in enumerate(self._plan.pairs)}
        points = self._plan.samples.T
        flat = self._plan.flat
        pairs: list[list[Any]] = [list(s.pairs) for s in self.inputs]
        blank = np.zeros(points.shape[1])
        columns = [np.array([points[rows[q]] if q in rows else blank for q in group]) for group in pairs]
        if self._uses_time:
            columns.append(np.full((1, points.shape[1]), self._plan.sampler.time))
        for block in self._plan.newton:
            columns.append(np.array([points[rows[q]] for s in block.unknowns if (q := flat.scope.owner(s))]))
        return columns

    def _nonlinear(self, name: str) -> ParameterError:
        return ParameterError(
            f"{self._efforts()} is not linear in parameter '{name}'; fix it at a number and leave it out of the list, "
            "or estimate it with gt.estimate",
            name,
        )

    def _efforts(self) -> str:
        return f"{', '.join(s.name for s in self.outputs)} of {self._title}"

    def _columns(self, rows: Sequence[Any]) -> list[Array]:
        expected = [(s.name, s.shape) for s in self.inputs] + [("time", ())] * self._uses_time
        if len(rows) != len(expected):
            names = ", ".join(n for n, _ in expected)
            raise TypeError(f"the regressor takes {len(expected)} arrays of rows ({names}); found {len(rows)}")
        columns, count = [], None
        for (name, shape), value in zip(expected, rows, strict=True):
            a = np.asarray(value, dtype=float)
            count = a.shape[0] if count is None and a.ndim else count
            if a.shape != (count, *shape):
                text = f"(n, {', '.join(map(str, shape))})" if shape else "(n,)"
                raise TypeError(f"the regressor: '{name}' takes shape {text}; found {a.shape}")
            columns.append(np.ascontiguousarray(a.reshape(a.shape[0], -1).T))
        return columns

    def __repr__(self) -> str:
        return f"Regressor({', '.join(self.columns)} linear in {', '.join(self.names)})"


def _partly_folded(causal: CausalFunction, chosen: Sequence[int]) -> CausalPlan:
    """The causal plan again, with symbols for the chosen parameters and numbers for the others; kept with the model,
    because a study and its checks ask for it several times."""
    flat = causal.flat
    known = [i for _, _, indices in causal.groups for i in indices]
    pairs = [p for s in causal.outputs for p in s.pairs]
    signs = tuple(sorted((causal.branches or {}).items()))
    key = "partly folded", *map(tuple, (known, pairs, causal.preferred, chosen)), signs
    if key not in flat.cache:
        fold = ca.SX(ca.DM(flat.require_values()))
        for k in chosen:
            fold[k] = flat.parameters[k].symbol
        flat.cache[key] = make_plan(flat, known, pairs, causal.preferred, causal.branches, fold=fold)
    return flat.cache[key]


def _elements(name: str, shape: tuple[int, ...]) -> list[str]:
    if not shape:
        return [name]
    return [f"{name}[{','.join(map(str, i))}]" for i in np.ndindex(*shape)]
