"""Inputs of components that equations determine; and static optimizations, with the equations at one instant."""

from __future__ import annotations

from typing import Any

from ..constraints import Flattened, ScalarEquation
from ..multibody.assembly import PART
from ..scalars import Flat, Operation, Symbol, is_number, number_of, operation, operations, symbols
from ..syntax import ModelicaError, Place


def _parts(equation: Any) -> list[Any]:
    """Return both sides of an equation, or of all equations of a conditional one."""
    equations = [*equation.then, *equation.otherwise] if hasattr(equation, "then") else [equation]
    return [x for e in equations if hasattr(e, "left") for x in (e.left, e.right)]


def settle_inputs(flats: list[Flat], equations: list[Any]) -> None:
    """Make inputs of components variables if equations determine them.

    Equations are matched with variables first, the remaining ones with inputs of components. So `u = sys.u`, or
    `sys.u = u`, determines a plain variable u, and sys.u stays an input; if another equation determines u, sys.u
    becomes a variable.
    """
    inner = [f for f in flats if f.kind == "input" and not f.top]
    if not inner:
        return
    rank = {id(f): n for n, f in enumerate(flats) if f.kind == "variable" and f.replaced is None}
    inputs = {id(f): n for n, f in enumerate(flats) if f.kind == "input" and not f.top}
    part_quantities: dict[Any, int] = {}  # quantities of parts, determined by equations of the parts
    for o in (o for q in equations for e in _parts(q) for o in operations(e) if o.name == PART):
        part_quantities.setdefault(o.arguments, len(flats) + len(part_quantities))
    rank |= {-1 - n: n for n in part_quantities.values()}
    uses = [list(dict.fromkeys(_keys(q, part_quantities))) for q in equations if _parts(q)]
    owner: dict[int, int] = {}
    unmatched = [n for n in range(len(uses)) if not augmented(n, uses, rank, owner)]
    allowed = rank | inputs
    for n in unmatched:
        augmented(n, uses, allowed, owner)
    for f in inner:
        if id(f) in owner:
            f.kind = "variable"


def _keys(equation: Any, part_quantities: dict[Any, int]) -> list[int]:
    keys = [id(f) for e in _parts(equation) for f in symbols(e)]
    return keys + [-1 - part_quantities[o.arguments] for e in _parts(equation) for o in operations(e) if o.name == PART]


def augmented(start: int, uses: list[list[int]], allowed: dict[int, int], owner: dict[int, int]) -> bool:
    """Match an equation with a variable along an augmenting path; False if there is none. Not recursive."""
    parents: dict[
        int, tuple[int, int | None]
    ] = {}  # variable -> equation that takes it, and the previous variable of that equation
    queue: list[tuple[int, int | None]] = [(start, None)]
    for equation, previous_variable in queue:
        for key in uses[equation]:
            if key not in allowed or key in parents:
                continue
            parents[key] = (equation, previous_variable)
            if key not in owner:
                current: int | None = key
                while current is not None:
                    taker, previous = parents[current]
                    owner[current] = taker
                    current = previous
                return True
            queue.append((owner[key], key))
    return False


_ENDS = ("start_time", "final_time")


def settle_static(out: Flattened) -> None:
    """Rewrite a static optimization: all equations and initial equations at the start time.

    der(x) is an unknown beside x, and fixed start values are equations. Variables that these do not determine become
    free parameters of the optimization. Raises ModelicaError for an objective integrand, a free time and a delay.
    """
    _Static(out).run()


class _Static:
    def __init__(self, out: Flattened) -> None:
        self.out = out
        self.rates: dict[int, Flat] = {}
        self._known: dict[int, tuple[Any, Any]] = {}
        start = out.header.get("startTime", 0.0)
        for name, at in out.header_at.items():
            if name == "objectiveIntegrand":
                raise ModelicaError(
                    "a static optimization has no time interval to integrate over; write objective instead", at
                )
            if name.endswith(".free"):
                raise ModelicaError("a static optimization has no free time; remove free", at)
        self.time = float(start) if is_number(start) else 0.0
        out.header["finalTime"] = self.time + 1.0  # any horizon; all variables are constant

    def run(self) -> None:
        out = self.out
        if not out.header.get("objective"):
            raise ModelicaError(f"the static optimization {out.name} has no objective", out.at)
        computed = {id(f) for f in out.flats if f.computed}
        equations: list[ScalarEquation] = []
        for e in (*out.equations, *out.initial):
            if not isinstance(e, ScalarEquation):
                raise ModelicaError(
                    "a static optimization does not support conditional equations; write if-expressions", e.at
                )
            if not _keeps(e, computed):
                equations.append(ScalarEquation(self._still(e.left), self._still(e.right), e.at))
        for f in list(out.flats):
            if f.kind == "variable" and f.replaced is None and f.get("fixed") is not None and not f.computed:
                if number_of(f.get("fixed"), f.at, f"fixed of '{f.name}'") is True:
                    start = f.get("start")
                    equations.append(ScalarEquation(Symbol(f), 0.0 if start is None else start, f.at))
                f.cache["fixed"] = None
        constraints = [
            ScalarEquation(self._still(c.left), self._still(c.right), c.at, c.relation) for c in out.constraints
        ]
        kept, others = self._determined(equations)
        out.equations = list(kept)
        out.initial = []
        out.header["objective"] = self._at(self._still(out.header["objective"]), out.header_at["objective"])
        out.constraints = [
            ScalarEquation(self._at(c.left, c.at), self._at(c.right, c.at), c.at, c.relation)
            for c in (*constraints, *others)
        ]
        if not any(f.kind == "variable" and f.replaced is None for f in out.flats):
            clock = Flat("clock", "variable", "Real", out.at, lambda _: None, lambda: None, description="time")
            out.flats.append(clock)  # all variables are free parameters, and a trajectory needs one variable
            out.equations.append(ScalarEquation(Symbol(clock), self.time, out.at))

    def _still(self, x: Any) -> Any:
        """Rewrite an expression: derivatives as variables, times as numbers, values at instants as values."""
        if not isinstance(x, Operation):
            return x
        if x.name == "der":
            (argument,) = x.arguments
            if not isinstance(argument, Symbol):
                raise ModelicaError(
                    "a static optimization does not support der() of an expression; declare a variable for it",
                    x.at,
                )
            return Symbol(self._rate(argument.flat))
        if x.name in ("time", *_ENDS):
            return self.time
        if x.name == "at":
            return self._still(x.arguments[0])
        if x.name == "delay":
            raise ModelicaError("delay() is not supported in a static optimization", x.at)
        if id(x) not in self._known:
            arguments = tuple(map(self._still, x.arguments))
            same = all(a is b for a, b in zip(arguments, x.arguments, strict=True))
            self._known[id(x)] = x, x if same else operation(x.name, arguments, x.at)
        return self._known[id(x)][1]

    def _rate(self, f: Flat) -> Flat:
        if id(f) not in self.rates:
            rate = Flat(f"der({f.name})", "variable", "Real", f.at, lambda _: None, lambda: None)
            self.rates[id(f)] = rate
            self.out.flats.append(rate)
        return self.rates[id(f)]

    def _determined(self, equations: list[ScalarEquation]) -> tuple[list[ScalarEquation], list[ScalarEquation]]:
        """Return equations matched with variables, and the others, for constraints; unmatched variables become free."""
        moving = [f for f in self.out.flats if f.kind in ("variable", "input") and f.replaced is None]
        uses = [list(dict.fromkeys(id(f) for x in (e.left, e.right) for f in symbols(x))) for e in equations]
        owner: dict[int, int] = {}
        first = {id(f): n for n, f in enumerate(moving) if f.kind == "variable"}
        candidates = {id(f): n for n, f in enumerate(moving)}
        unmatched = [n for n in range(len(uses)) if not augmented(n, uses, first, owner)]
        others = {n for n in unmatched if not augmented(n, uses, candidates, owner)}
        for f in moving:
            if id(f) in owner:
                f.kind = "variable"
            else:
                f.kind, f.free = "parameter", True
                guess = next((g for g in (f.get("initialGuess"), f.get("start"), f.get("nominal")) if g is not None), 0)
                f.cache["initialGuess"] = number_of(guess, f.at, f"the guess of '{f.name}'")
        kept = [e for n, e in enumerate(equations) if n not in others]
        return kept, [e for n, e in enumerate(equations) if n in others]

    @staticmethod
    def _at(x: Any, at: Place) -> Any:
        """Return the value of an expression at the final time; unchanged if it has no variables."""
        if any(f.kind in ("variable", "input") for f in symbols(x)):
            return Operation("at", (x, Operation("final_time", (), at)), at)
        return x


def _keeps(e: Any, computed: set[int]) -> bool:
    """True for an equation der(p) = 0 of a parameter that initial equations determine."""
    x = e.left if isinstance(e, ScalarEquation) else None
    if not isinstance(x, Operation) or x.name != "der" or not isinstance(x.arguments[0], Symbol):
        return False
    return id(x.arguments[0].flat) in computed
