"""CausalFunction: one causality as a numeric function that returns values and a status."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from .._pickling import Portable
from ..lang.builder import Builder
from ..lang.model import Model
from ..lang.scope import derivative_name
from ..lang.slips import named, shortened
from ..lang.source import ModelError
from ..results.status import Status
from .analysis.sizes import DOUBLE, Precision, Sizes, sizes_of
from .blocks import VERDICTS
from .columns.kernel import PAID, kernel_of
from .consistency.guess import Completion
from .consistency.home import moved_sentence, refuse_starts
from .derivative import jacobian_of
from .evaluate import Built, CausalSignal as CausalSignal, build, c_name as c_name
from .explain import explain
from .flat import FlatModel
from .flat_cache import flat_of
from .newton import NewtonKernel
from .plan import CausalPlan, make_plan
from .rows import PIVOT_TOLERANCE, JudgedFunction
from .tunable import with_parameters

Pair = tuple[int, int]
Group = tuple[str, tuple[int, ...], list[int]]


class CausalFunction(Portable):
    """The function that `Model.causal` returns: values and a status, for a choice of known variables and targets.

    Call it with one argument per entry of `inputs` (states first, then the known variables and their
    derivatives as far as needed), each of the signal's shape or with a leading row axis (n, ...). It returns
    one array per target, then the status: a `Status` for a single call, an int array (n,) of Status codes for
    rows. It never raises because of data: a row without a solution is NaN, and its status gives the reason. Numbers are
    in SI units.

    `explain()` describes how the values are computed, `diagnose(...)` why a call has no solution. `jacobian(...)`
    returns exact derivatives, `casadi` is the same function for CasADi, and gt.cgen generates C code from it.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> fk = robot.causal(known="q", targets="T")
    >>> T, status = fk([-0.7, -0.8, -0.6])
    >>> T.round(3).tolist(), status
    ([0.911, -0.883, 0.463], <Status.OK: 0>)
    >>> T, status = fk([[-0.7, -0.8, -0.6], [-0.7, 9.0, -0.6]])  # two rows; the second cannot be assembled
    >>> T.shape, status.tolist()
    ((2, 3), [0, 1])
    >>> J, status = fk.jacobian([-0.7, -0.8, -0.6])
    >>> J.shape
    (3, 3)
    """

    def __init__(
        self,
        plan: CausalPlan,
        inputs: list[CausalSignal],
        outputs: list[CausalSignal],
        name: str,
        groups: Sequence[Group] = (),
        preferred: Sequence[int] = (),
        branches: Mapping[str, int] | None = None,
    ) -> None:
        self.plan = plan
        self.groups, self.preferred, self.branches = list(groups), list(preferred), dict(branches or {})
        self.flat = plan.flat
        self.inputs = inputs
        self.outputs = outputs
        self.name = name
        self.margins = plan.margins
        self.made: tuple[Any, ...] | None = None  # arguments of `compile_causal`
        self.kept: dict[Any, Any] = {}  # cache for results that other modules derive from this function

    def _reduced(self, pickler: Any) -> tuple[Any, ...]:
        return super()._reduced(pickler) if self.made is None else (compile_causal, self.made)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "kept": {}}

    def again(self, plan: CausalPlan, inputs: list[CausalSignal]) -> CausalFunction:
        """Return the same causality with another plan and other inputs."""
        return CausalFunction(plan, inputs, self.outputs, self.name, self.groups, self.preferred, self.branches)

    def __copy__(self) -> CausalFunction:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> CausalFunction:
        return self

    @cached_property
    def sizes(self) -> Sizes:
        """The largest size of each argument; beyond it the status is OUT_OF_RANGE."""
        return self.sizes_in(DOUBLE)

    def sizes_in(self, precision: Precision) -> Sizes:
        """Return the largest sizes of the arguments for another precision than double."""
        arguments = [*[s.pairs for s in self.inputs], *([()] if self.plan.uses_time else [])]
        return sizes_of(self.plan, arguments, precision)

    @cached_property
    def _built(self) -> Built:
        return build(self.plan, *self._signals(), c_name(self.name))

    def _signals(self) -> tuple[list[tuple[str, Sequence[Pair]]], list[tuple[str, Sequence[Pair]]]]:
        inputs: list[tuple[str, Sequence[Pair]]] = [(c_name(s.name), s.pairs) for s in self.inputs]
        outputs: list[tuple[str, Sequence[Pair]]] = [(c_name(s.name), s.pairs) for s in self.outputs]
        return inputs, outputs

    @property
    def casadi(self) -> ca.Function:
        """ca.Function (inputs...) -> (targets..., status, margins), with the parameters as numbers.

        The values are valid only if `status`, a code of `Status`, is 0. For Newton blocks it contains root finders that
        continue each block from the home pose in a fixed number of steps. A call of this object takes as many steps as
        it needs, so its status can be OK where this function has NOT_CONVERGED.
        """
        return self._built.whole

    @property
    def closed(self) -> ca.Function:
        """ca.Function (inputs..., unknowns of each Newton block...) -> (targets..., margins), without root finders."""
        return self._built.closed

    @property
    def kernels(self) -> list[NewtonKernel]:
        """The kernels of the Newton blocks, in order; empty for a closed form."""
        return self._built.kernels

    def unknowns(self, *arguments: Any) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the unknowns of each Newton block as rows (n, m), the further inputs of `closed`, and a Status code
        per row. The list is empty without Newton blocks. Arguments as for a call of this object."""
        columns, _ = self._columns(arguments)
        zs, status = self._unknowns(columns)
        return [z.T for z in zs], status

    @cached_property
    def casadi_parametric(self) -> ca.Function:
        """ca.Function (inputs..., parameters) -> (targets..., status, margins), with symbolic parameters.

        Roots keep the signs that they have at the model's parameter values.
        """
        known = [i for _, _, indices in self.groups for i in indices]
        pairs = [p for s in self.outputs for p in s.pairs]
        plan = make_plan(self.flat, known, pairs, self.preferred, self.branches)
        return build(plan, *self._signals(), c_name(self.name), parametric=True).whole

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user: start values that do not satisfy the equations, the home pose, and preferred states that
        are not states."""
        states = {index for index, _ in self.plan.states}
        others = [i for i in self.preferred if self.plan.alias.resolve(i, 0)[1] not in states]
        names = ", ".join(f"'{self.flat.variables[i].name}'" for i in others)
        preferred = f"preferred as states, but not states of this causality: {names}" if others else ""
        return tuple(filter(None, [moved_sentence(self.flat, self.plan.moved), preferred, self._undetermined]))

    @property
    def _undetermined(self) -> str:
        """Return a sentence if a target is a reaction that redundant constraints leave undetermined."""
        loose = self.flat.loops.loose
        flows = {v.name: v.component for v in self.flat.variables if v.role == "flow"} if loose else {}
        owners = {self.flat.variables[i].component for s in self.outputs for i, _ in s.pairs
                  if self.flat.variables[i].name in flows}  # fmt: skip
        hit = sorted(joint for joint in loose if any(o == joint or o.startswith(f"{joint}.") for o in owners))
        return (
            f"forces of {', '.join(hit)} depend on which redundant constraints were dropped; see explain()"
            if hit
            else ""
        )

    @property
    def parameter_names(self) -> list[str]:
        """Names of the entries of the parameter vector."""
        return [q.name for q in self.flat.parameters]

    def __call__(self, *arguments: Any, guess: Mapping[str, Any] | None = None) -> Any:
        """Return the values of the targets, then the status. Raises TypeError for a wrong number or shape of arguments.

        guess: initial guess for the Newton blocks by name of any variable, each of the variable's shape or with rows;
        for example the last sample of a controller, or the solution of a simpler model. Unknowns that it does not
        determine follow from the equations, starting at the home pose. A guess selects a solution if Newton's
        corrections from it shrink to a quarter or less each time; for the six joints of an arm that is about 0.005 rad.
        All other rows ignore the guess and are continued from the home pose, so far from home move the start instead:
        `model.with_(q={"start": ...})`. If a declared branch has another sign at the solution than at the
        home pose, the status is WRONG_BRANCH: select that solution with `branches`.
        """
        columns, rows = self._columns(arguments)
        guesses = self._guesses(guess, columns) if guess else None
        results, status = self._evaluate(columns, guesses, answers=True)
        if rows is None:
            values = [r.reshape(s.shape) if s.shape else float(r[0, 0])
                      for r, s in zip(results, self.outputs, strict=True)]  # fmt: skip
            return (*values, Status(code) if (code := int(status[0])) else Status.OK)
        return (*(r.T.reshape(rows, *s.shape) for r, s in zip(results, self.outputs, strict=True)), status)

    def compile(self) -> bool:
        """Compile machine code for calls on many rows, or load it from the cache folder; False without a C compiler.

        Otherwise this happens once NumPy has spent as much time on rows as a compiler needs. The results are the same
        to the last bit.
        """
        kernels = [kernel_of(f, PAID) for f in (self.closed, *[g for k in self.kernels for g in k.functions])]
        return all([k is not None and k.machine.make(True) for k in kernels])

    def arguments_along(self, *motion: Any) -> list[Any]:
        """Return the arguments of a call for a motion of the only known variable: position, velocity, ...; derivatives
        that are not passed are zero."""
        orders = [s.pairs[0][1] for s in self.inputs]
        return [motion[k] if k < len(motion) else np.zeros_like(motion[0]) for k in orders]

    def along(self, *motion: Any) -> Any:
        """Call for a motion of the only known variable: position, velocity, ...; derivatives not passed are zero."""
        return self(*self.arguments_along(*motion))

    def jacobian(self, *arguments: Any) -> tuple[np.ndarray, Any]:
        """Return d targets / d inputs, (outputs, inputs) or (n, outputs, inputs), and the status."""
        columns, rows = self._columns(arguments)
        full, status = jacobian_of(self, columns)
        return (full[0], Status(int(status[0]))) if rows is None else (full, status)

    def _guesses(self, guess: Mapping[str, Any], columns: list[np.ndarray]) -> list[np.ndarray | None]:
        """Return the start values of each Newton block as columns; None if the guess says nothing about a block."""
        n = columns[0].shape[1] if columns else 1
        values: dict[Pair, np.ndarray] = {}
        for text, value in guess.items():
            shape, indices, order = self.flat.lookup(text)
            a = np.asarray(value, dtype=float)
            if a.shape not in (shape, (n, *shape)):
                raise TypeError(
                    f"{self.name}: the guess of '{text}' must have shape {shape} or ({n}, ...); found {a.shape}"
                )
            flat = np.broadcast_to(a.reshape(-1, len(indices)), (n, len(indices)))
            for k, i in enumerate(indices):
                sign, kept, m = self.plan.alias.resolve(i, order)
                values[kept, m] = sign * flat[:, k]
        unknowns = [[p for p in map(self.flat.scope.owner, b.unknowns) if p is not None] for b in self.plan.newton]
        missing = [p for pairs in unknowns for p in pairs if p not in values]
        usable = {p: g for p, g in values.items() if self._completion.knows(p)}
        if missing and not usable:
            return [None] * len(unknowns)
        if missing:
            rows = np.vstack(columns) if columns else np.zeros((0, n))
            values |= dict(zip(missing, self._completion(rows, usable, missing), strict=True))
        return [np.array([values[p] for p in pairs]) for pairs in unknowns]

    @cached_property
    def _completion(self) -> Completion:
        return Completion(self.plan, [p for s in self.inputs for p in s.pairs])

    def _unknowns(
        self, columns: list[np.ndarray], guesses: Sequence[np.ndarray | None] | None = None
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the unknowns of the Newton blocks, and a status code for each row."""
        n = columns[0].shape[1] if columns else 1
        code = np.zeros(n, dtype=int)
        zs: list[np.ndarray] = []
        if not self._built.kernels:
            return zs, code
        block_inputs = np.vstack(columns) if columns else np.zeros((0, n))
        block_inputs = np.where(
            self.sizes.within(columns), block_inputs, np.nan
        )  # rows with too large arguments are not solved
        for k, kernel in enumerate(self._built.kernels):
            z, converged, singular = kernel.solve(block_inputs, None if guesses is None else guesses[k])
            code = np.where((code == 0) & ~converged, Status.NOT_CONVERGED, code)
            code = np.where((code == 0) & singular, Status.SINGULAR, code)
            zs.append(z)
            block_inputs = np.vstack([block_inputs, z])
        return zs, code

    def _evaluate(
        self, columns: list[np.ndarray], guesses: Sequence[np.ndarray | None] | None = None, answers: bool = False
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Return targets and margins as columns, and status codes; answers: no margins, and NaN without a solution."""
        zs, iteration = self._unknowns(columns, guesses) if self._built.kernels else ([], None)
        return self._judged(columns, zs, iteration, answers)

    @cached_property
    def _judged(self) -> JudgedFunction:
        return JudgedFunction(self.closed, self.margins, self.sizes)

    def status(
        self, columns: list[np.ndarray], results: list[np.ndarray], iteration: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the status code of each column, from the inputs, the `iteration` codes, margins and outputs; the first
        cause counts."""
        return self._judged.codes(columns, results, iteration)

    def diagnose(self, *arguments: Any) -> str:
        """Return one sentence about a single call: ok, or which root or pivot failed and by how much."""
        columns, _ = self._columns(arguments)
        results, codes = self._evaluate(columns)
        status = Status(int(codes[0]))
        if status is Status.OUT_OF_RANGE and (large := self._too_large(columns)):
            return f"{status.message}: {large}"
        if status is Status.NOT_CONVERGED:
            reason = f"the continuation from the home pose {self._continued()}"
            return "; ".join([f"{status.message}: {reason}", *self.notes])
        for m, row in zip(self.margins, results[-1], strict=True):
            value = float(row[0])
            if VERDICTS[m.kind] is not status:
                continue
            if m.kind == "condition" and not value >= 0:
                return f"{status.message}: the known values do not satisfy {m.label}"
            if m.kind == "solution" and not value >= 0:
                return f"{status.message}: no solution satisfies {m.label} together with the other known values"
            if m.kind == "limit" and not value >= 0:
                return f"{status.message}: no solution was found within the limits of {m.label}"
            if m.kind == "turn" and not value >= 0:
                return f"{status.message}: the iteration found {m.label}"
            if m.kind == "discriminant" and not value >= 0:
                reason = f"{m.label} has no real solution, the radicand of its square root is {value:.4g}"
                return f"{status.message}: {reason}"
            if m.kind == "branch" and not value > PIVOT_TOLERANCE * m.scale:
                reason = (
                    f"branch {m.label} is selected, but its signed expression is {value:.4g}, typically {m.scale:.4g}"
                )
                return (
                    f"{status.message}: {reason}; use known values nearer to home, or select the other with `branches`"
                )
            if m.kind == "pivot" and not abs(value) > PIVOT_TOLERANCE * m.scale:
                return f"{status.message}: the pivot for {m.label} is {abs(value):.4g}, typically {m.scale:.4g}"
        return status.message

    def _continued(self) -> str:
        """Return the home values of the unknowns of Newton's method that the model names, and the advice to move them;
        without such a name, the unknowns."""
        home = {n: z for k in self._built.kernels for n, z in zip(k.label.split(", "), k.z0, strict=True)}
        for name, (_, indices) in self.flat.groups.items():
            entries = [self.flat.variables[i].name for i in indices]
            if "." not in name and entries and home.keys() >= set(entries):
                values = ", ".join(f"{home[e]:.3g}" for e in entries)
                return (
                    f"{name} = [{values}] found no solution: the known values may be out of reach, or far from home; "
                    f"move the start, model.with_({name}={{'start': ...}}), or pass a guess={{'{name}': ...}} that is "
                    "nearly the solution"
                )
        return f"found no solution for {', '.join(home)}"

    def _too_large(self, columns: list[np.ndarray]) -> str:
        """Return a sentence about the argument of a single call that is too large, or ""."""
        if self.sizes.within(columns)[0]:
            return ""
        size = [float(np.max(np.abs(c[:, 0]), initial=0.0)) for c in columns]
        n = int(np.argmax([s / limit for s, limit in zip(size, self.sizes.limits, strict=True)]))
        return (
            f"{[*[s.name for s in self.inputs], 'time'][n]} has the size {size[n]:.4g}, and near "
            f"{self.sizes.limits[n]:.4g} round-off reaches the lengths in the model; check its unit"
        )

    @cached_property
    def _expected(self) -> list[tuple[str, tuple[int, ...], int]]:
        """Name, shape and number of entries of each argument."""
        expected = [(s.name, s.shape, s.size) for s in self.inputs]
        return [*expected, ("time", (), 1)] if self.plan.uses_time else expected

    def _columns(self, arguments: Sequence[Any]) -> tuple[list[np.ndarray], int | None]:
        """Return the arguments as columns (entries, n), and n; None for a single call."""
        expected = self._expected
        if len(arguments) != len(expected):
            names = ", ".join(n for n, _, _ in expected)
            plural = "" if len(expected) == 1 else "s"
            raise TypeError(f"{self.name} takes {len(expected)} argument{plural} ({names}); found {len(arguments)}")
        rows: int | None = None
        columns: list[np.ndarray] = []
        for (name, shape, size), value in zip(expected, arguments, strict=True):
            try:
                a = np.asarray(value, dtype=float)
            except (TypeError, ValueError):
                raise TypeError(
                    f"{self.name}: '{name}' must be numbers of shape {shape} or (n, ...); found {shortened(value)}"
                ) from None
            given = a.shape
            if given == shape:
                columns.append(a.reshape(size, 1))
            elif given[1:] == shape and a.ndim == len(shape) + 1:
                if rows is not None and rows != given[0]:
                    raise TypeError(f"{self.name}: '{name}' has {given[0]} rows, another argument has {rows}")
                rows = given[0]
                columns.append(a.reshape(given[0], size).T)
            else:
                raise TypeError(f"{self.name}: '{name}' must have shape {shape} or (n, ...); found {given}")
        if rows is not None:
            columns = [c if c.shape[1] == rows else np.broadcast_to(c, (len(c), rows)) for c in columns]
        return columns, rows

    def explain(self, full: bool = True) -> str:
        """Return a text on how the values are computed: blocks, sizes, branch signs, assumptions, file and line."""
        return explain(self, full)

    def __repr__(self) -> str:
        return f"CausalFunction({', '.join(s.name for s in self.inputs)} -> {', '.join(s.name for s in self.outputs)})"


@named
def compile_causal(
    model: Model | Builder | FlatModel,
    known: str | Sequence[str] = (),
    targets: str | Sequence[str] = (),
    prefer: str | Sequence[str] = (),
    branches: Mapping[str, int] | None = None,
    name: str | None = None,
    tunable: str | Sequence[str] = (),
) -> CausalFunction:
    """Return the function that computes `targets` from `known`, for any causality of the model.

    Args:
        known: names of variables that are known with all their derivatives.
        targets: names such as "T", "der(q)", "der(T,2)", "arm[0].rod.tension".
        prefer: names of preferred states, if the known variables do not determine everything.
        branches: sign +1 or -1 by declared branch name, see `gt.branch`; +1 by default.
        name: name of the function in messages and in C; by default derived from targets and known.
        tunable: names of model parameters, or of single numbers such as "coulomb[0]", that become inputs. One function
            then serves all their values, also in C; results agree with those of `with_` to rounding. Signs of roots and
            largest sizes of arguments are those at the model's values.

    The inputs of the function are the states, the known variables with the derivatives that are needed, and the tunable
    parameters. Discrete variables, which only events change, keep their start values. Raises ModelError, with file and
    line of the equations, if the model is wrong or the known variables do not determine the targets; ArgumentError for
    a parameter that cannot be tunable.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> inverse_dynamics = robot.causal(known="T", targets="tau")
    >>> [signal.name for signal in inverse_dynamics.inputs]
    ['T', 'der(T)', 'der(T,2)']
    >>> forward_dynamics = robot.causal(known="tau", targets="der(T,2)", prefer="T")
    >>> [signal.name for signal in forward_dynamics.inputs]
    ['T', 'der(T)', 'tau']
    >>> loaded = robot.causal(known="T", targets="tau", tunable="m_p")
    >>> tau, status = loaded(robot.home, np.zeros(3), np.zeros(3), [9.1, 19.1])  # N, at rest with 10 kg more
    >>> tau.shape, float((tau[1] - tau[0]).sum().round(9))
    ((2, 3), 0.0)
    """
    flat = model if isinstance(model, FlatModel) else flat_of(model)
    known, targets, prefer = _names("known", known), _names("targets", targets), _names("prefer", prefer)
    free = _names("tunable", tunable)
    key = (tuple(known), tuple(targets), tuple(prefer), tuple(sorted((branches or {}).items())), name, tuple(free))
    if key not in flat.cache:
        if free:
            numeric = compile_causal(flat, known, targets, prefer, branches, name)
            function, _ = with_parameters(numeric, free, "tunable")
        else:
            function = _compile(flat, known, targets, prefer, branches, name)
        flat.cache[key] = function
        function.made = flat, known, targets, prefer, branches and dict(branches), name, free
    return flat.cache[key]


def notes_of(model: Model | Builder) -> list[str]:
    """Return the notes of all functions compiled from a model so far, each once."""
    flat = getattr(model, "_flat", None)
    functions = [] if flat is None else [f for f in flat.cache.values() if isinstance(f, CausalFunction)]
    return list(dict.fromkeys(note for f in functions for note in f.notes))


def _names(argument: str, value: Any) -> list[str]:
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, (list, tuple)) or not all(isinstance(n, str) for n in names):
        raise ModelError(f"{argument} takes names of variables, such as 'T' or 'der(q)'; found {value!r}")
    return list(names)


def _compile(
    flat: FlatModel,
    known: list[str],
    targets: list[str],
    prefer: list[str],
    branches: Mapping[str, int] | None,
    name: str | None,
) -> CausalFunction:
    if not targets:
        raise ModelError(f"{flat.title}: there is no target; name at least one variable to compute")
    groups = []
    for text in known:
        shape, indices, order = flat.lookup(text)
        if order:
            raise ModelError(
                f"'{text}' cannot be known without '{flat.variables[indices[0]].name}' itself; name the variable"
            )
        groups.append((text, shape, indices))
    indices = [i for _, _, g in groups for i in g]
    if len(set(indices)) != len(indices):
        raise ModelError(f"{flat.title}: a known variable is named twice in {', '.join(known)}")
    inside = flat.scope.symbols_in_each([e.residual for e in flat.equations])
    used = {i for pairs in inside for i, _ in pairs}
    for i in indices:
        if i not in used:
            raise ModelError(f"'{flat.variables[i].name}' is known, but no equation uses it; remove it from known")
    outputs = []
    for text in targets:
        shape, group, order = flat.lookup(text)
        base = text if not text.startswith("der(") else _base(flat, group, shape)
        outputs.append(_signal(flat, base, shape, group, order))
    preferred = [i for text in prefer for i in flat.lookup(text)[1]]
    pairs = [p for s in outputs for p in s.pairs]
    numbers = ca.SX(ca.DM(flat.require_values()))
    plan = make_plan(flat, indices, pairs, preferred, branches, fold=numbers)
    refuse_starts(flat, plan.alias, plan.sampler, plan.moved)
    signals = input_signals(plan, groups)
    return CausalFunction(plan, signals, outputs, name or _function_name(outputs, groups), groups, preferred, branches)


def input_signals(plan: CausalPlan, groups: list[Group]) -> list[CausalSignal]:
    """Return the states, then the known variables with the derivatives that are needed."""
    flat = plan.flat
    known = {i for _, _, g in groups for i in g}
    states = state_groups(plan, [p for p in plan.inputs if p[0] not in known])
    signals = [_signal(flat, name, shape, indices, order) for order, name, shape, indices in states]
    for name, shape, indices in groups:
        top = max([order for i, order in plan.inputs if i in indices], default=-1)
        signals += [_signal(flat, name, shape, indices, order) for order in range(top + 1)]
    return signals


def _signal(flat: FlatModel, name: str, shape: tuple[int, ...], indices: list[int], order: int) -> CausalSignal:
    unit = flat.unit_of(indices[0], order)
    return CausalSignal(derivative_name(name, order), shape, unit, tuple((i, order) for i in indices))


def state_groups(plan: CausalPlan, states: list[Pair]) -> list[tuple[int, str, tuple[int, ...], list[int]]]:
    """Group state symbols into declared vectors if these are complete."""
    flat = plan.flat
    remaining = set(states)
    result = []
    for order in sorted({k for _, k in states}):
        for name, (shape, indices) in sorted(flat.groups.items(), key=lambda g: (g[0].count("."), g[1][1][:1])):
            if shape and indices and all((i, order) in remaining for i in indices):
                result.append((order, name, shape, list(indices)))
                remaining -= {(i, order) for i in indices}
        for i, k in sorted(remaining):
            if k == order:
                result.append((order, flat.variables[i].name, (), [i]))
    return result


def _base(flat: FlatModel, group: list[int], shape: tuple[int, ...]) -> str:
    if not shape:
        return flat.variables[group[0]].name
    return next(n for n, (s, g) in flat.groups.items() if g == group and s == shape)


def _function_name(outputs: list[CausalSignal], groups: list[Group]) -> str:
    out = "_".join(c_name(s.name) for s in outputs)
    return f"{out}_from_{'_'.join(c_name(n) for n, _, _ in groups)}" if groups else out
