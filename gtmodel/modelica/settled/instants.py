"""Event semantics: Modelica solves all equations of an instant together, gtmodel iterates; this pass handles that."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ..constraints import Flattened, ScalarEquation, ScalarIf, ScalarWhen, WhenBranch
from ..scalars import Flat, Operation, Symbol, nodes, operation, operations, symbols
from ..syntax import ModelicaError, Place
from .static import augmented


def settle_instants(out: Flattened, memories: set[int]) -> None:
    """Substitute in actions variables that depend on discrete variables; reject clauses that would act too late.

    In Modelica all equations of an instant hold simultaneously: a variable that depends on a discrete variable has its
    new value in every action. In gtmodel actions read the previous values of continuous variables and the new values
    of discrete ones. Therefore a variable that depends algebraically on discrete variables is replaced in actions by
    its expression in them. A condition that discrete variables make true acts in the next iteration of the event. The
    result is the same unless an action reads a variable that this clause sets, or pre() of one that made it true.

    memories: ids of the discrete variables that hold values of pre(). Raises ModelicaError.
    """
    whens = [e for e in out.equations if isinstance(e, ScalarWhen)]
    if not any(not w.internal for w in whens):
        return
    instants = _Instants(out, memories)
    out.equations = [instants.written(e) if isinstance(e, ScalarWhen) and not e.internal else e for e in out.equations]
    instants.check([e for e in out.equations if isinstance(e, ScalarWhen) and not e.internal])


class _Instants:
    def __init__(self, out: Flattened, memories: set[int]) -> None:
        self.out = out
        clauses = [e for e in out.equations if isinstance(e, ScalarWhen) and not e.internal]
        self.set = {id(a.left.flat) for w in clauses for a in w.actions} - memories
        self.equations = [e for e in out.equations if not isinstance(e, ScalarWhen)]
        self.states = {id(f) for e in self.equations for x in _sides(e) for f in _under_der(x)}
        self._group: dict[int, int] = {}
        self._follows: dict[int, set[int]] = {}
        for e in self.equations:
            self._join(e)
        self._definitions: dict[int, Any] | None = None
        self._written: dict[int, tuple[Any, Any]] = {}

    # dependencies

    def _root(self, key: int) -> int:
        while self._group.setdefault(key, key) != key:
            self._group[key] = self._group[self._group[key]]
            key = self._group[key]
        return key

    def _moving(self, f: Flat) -> bool:
        return f.kind in ("variable", "input") and f.replaced is None and id(f) not in self.states

    def _join(self, e: Any) -> None:
        """Assume that the variables of one equation depend on each other and on its discrete variables."""
        variables = [f for x in _sides(e) for f in symbols(x)]
        roots = {self._root(id(f)) for f in variables if self._moving(f)}
        read = {id(f) for f in variables if id(f) in self.set}
        if not roots:
            return
        first = min(roots)
        for root in roots:
            self._group[root] = first
            read |= self._follows.pop(root, set())
        self._follows[first] = self._follows.get(first, set()) | read

    def follows(self, f: Flat) -> set[int]:
        """Return the ids of discrete variables on which a continuous variable may depend algebraically."""
        return self._follows.get(self._root(id(f)), set()) if self._moving(f) else set()

    def read(self, x: Any) -> set[int]:
        """Return the ids of discrete variables whose current values an expression reads."""
        result: set[int] = set()
        for f in _now(x):
            result |= {id(f)} & self.set
            result |= self.follows(f)
        return result

    # actions

    def written(self, when: ScalarWhen) -> ScalarWhen:
        """Return a when clause with variables that depend on discrete ones substituted in its actions."""
        branches = []
        for b in when.branches:
            actions = tuple(ScalarEquation(a.left, self._out(a.right, a.at), a.at) for a in b.actions)
            restarts = tuple((x, self._out(v, b.at)) for x, v in b.restarts)
            branches.append(replace(b, actions=actions, restarts=restarts))
        return replace(when, branches=tuple(branches))

    def _out(self, x: Any, at: Place, busy: tuple[int, ...] = ()) -> Any:
        if isinstance(x, Symbol):
            if not self.follows(x.flat):
                return x
            if id(x.flat) in busy or id(x.flat) not in self.definitions():
                names = ", ".join(sorted(f.name for f in self.out.flats if id(f) in self.follows(x.flat)))
                raise ModelicaError(
                    f"this action reads '{x.flat.name}', which depends at the same instant on {names}; write an "
                    f"explicit equation {x.flat.name} = ..., or use pre() in the action",
                    at,
                )
            return self._out(self.definitions()[id(x.flat)], at, (*busy, id(x.flat)))
        if not isinstance(x, Operation) or x.name in ("pre", "earlier", "der"):
            return x
        if id(x) not in self._written:
            arguments = tuple(self._out(a, at, busy) for a in x.arguments)
            same = all(a is b for a, b in zip(arguments, x.arguments, strict=True))
            self._written[id(x)] = x, x if same else operation(x.name, arguments, x.at)
        return self._written[id(x)][1]

    def definitions(self) -> dict[int, Any]:
        """Of each variable that an equation v = ... determines the other side."""
        if self._definitions is None:
            self._definitions = {}
            uses: list[list[int]] = []
            allowed: dict[int, int] = {}
            for e in self.equations:
                keys: list[int] = []
                for x in _sides(e):
                    keys += [-id(f) for f in _under_der(x)]
                    keys += [id(f) for f in symbols(x) if self._moving(f) and (f.kind != "input" or not f.top)]
                uses.append(list(dict.fromkeys(keys)))
                allowed |= dict.fromkeys(keys, 0)
            owner: dict[int, int] = {}
            for n in range(len(uses)):
                augmented(n, uses, allowed, owner)
            for key, n in owner.items():
                e = self.equations[n]
                if isinstance(e, ScalarEquation):
                    for a, b in ((e.left, e.right), (e.right, e.left)):
                        if isinstance(a, Symbol) and id(a.flat) == key:
                            self._definitions[key] = b
        return self._definitions

    # iterations of an event

    def check(self, whens: list[ScalarWhen]) -> None:
        """Raises ModelicaError for a clause that acts one iteration late with a result different from Modelica."""
        setters: dict[int, set[int]] = {}
        for n, w in enumerate(whens):
            for a in w.actions:
                setters.setdefault(id(a.left.flat), set()).add(n)
        for n, w in enumerate(whens):
            assigned = {id(a.left.flat) for a in w.actions}
            reads = [self.read(b.condition) for b in w.branches]
            for k, (b, triggers) in enumerate(zip(w.branches, reads, strict=True)):
                if not triggers:
                    continue
                if triggers & assigned:
                    raise ModelicaError(
                        f"this condition reads {self._names(triggers & assigned)}, which its own clause sets; "
                        "write pre(...)",
                        b.at,
                    )
                if any(one != triggers for one in reads[k + 1 :]):
                    raise ModelicaError(
                        f"this condition depends on {self._names(triggers)} of the same instant; gtmodel cannot keep "
                        "the precedence over its elsewhen branches; write pre(...), or a separate when clause",
                        b.at,
                    )
                if earlier := {f for f in _earlier(b) if setters.get(id(f), set()) - {n}}:
                    raise ModelicaError(
                        f"pre({min(f.name for f in earlier)}) is read at the instant at which {self._names(triggers)} "
                        "makes the condition true; combine both in one when clause",
                        b.at,
                    )
                for m, other in enumerate(whens):
                    for c in other.branches if m != n else ():
                        shared = {i for x in _values(c) for i in self.read(x)} & assigned
                        if shared and not self.read(c.condition) & assigned:
                            raise ModelicaError(
                                f"this action reads {self._names(shared)}, which {self._names(triggers)} may set at "
                                f"the same instant, in line {w.at.line}; write pre(...), or combine both clauses",
                                c.at,
                            )

    def _names(self, ids: set[int]) -> str:
        return ", ".join(f"'{n}'" for n in sorted(f.name for f in self.out.flats if id(f) in ids))


def _sides(e: Any) -> list[Any]:
    if isinstance(e, ScalarIf):
        return [e.condition, *(x for part in (*e.then, *e.otherwise) for x in (part.left, part.right))]
    return [e.left, e.right]


def _values(b: WhenBranch) -> list[Any]:
    return [*(a.right for a in b.actions), *(v for _, v in b.restarts)]


def _under_der(x: Any) -> Iterator[Flat]:
    """Yield variables under der()."""
    for o in operations(x):
        if o.name == "der":
            yield from symbols(o.arguments[0])


def _now(x: Any) -> Iterator[Flat]:
    """Yield the variables of an expression that are not in pre(); conditions write it as "earlier"."""
    return (e.flat for e in nodes(x, closed=("pre", "earlier")) if isinstance(e, Symbol))


def _earlier(b: WhenBranch) -> Iterator[Flat]:
    """Yield variables in pre() of the actions."""
    for x in _values(b):
        for e in operations(x):
            if e.name == "pre":
                yield from symbols(e)
