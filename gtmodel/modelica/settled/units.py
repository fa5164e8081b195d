"""Units of a text: checked where they fit, and told where they do not, one line at a time."""

from __future__ import annotations

import ast
from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from typing import Any

from ...compiler.causal import flat_of
from ...lang.model import Model
from ...lang.optimization import Optimization
from ...lang.source import ModelError
from ...lang.units import UnitError
from ..classes import class_of, exact
from ..constraints import Flattened
from ..python import Writer

# declarations whose attributes do not fit their units, one after the other
MOST = 50


def fitted(flat: Flattened) -> tuple[type[Model], bool, list[str]]:
    """A class of a flattened text, whether it has units, and what they were told of.

    Where units do not fit in an equation, or in a declaration, that line alone goes without: `flat.bare` and
    `flat.without_unit` say so, for whoever writes the class again.
    """
    if not any(f.get("unit") for f in flat.flats):
        return class_of(Writer(flat, exact, units=False).write()), False, []
    said: list[str] = []
    refused: Exception | None = None
    for _ in range(MOST):
        writer = Writer(flat, exact, units=True)
        written = writer.write()
        cls = class_of(written)
        try:
            _checked(cls)
        except (ModelError, UnitError) as error:
            refused = error
        else:
            return cls, True, [*writer.warnings, *dict.fromkeys(said)]
        if not isinstance(refused, UnitError):
            break  # who solves it says so
        errors = _complaints(written)
        flat.bare |= set(errors)
        said += [f"not checked: {error}" for error in errors.values()]
        if not errors:
            own = {id(f) for f in flat.flats if f.at.where == getattr(refused, "where", None)} - flat.without_unit
            if not own:
                break
            flat.without_unit |= own
            said.append(f"unit left out: {refused}")
    plain = class_of(Writer(flat, exact, units=False).write())
    try:
        _checked(plain)
    except (ModelError, UnitError):
        return plain, False, []  # who solves it says so
    return plain, False, [f"units are not used: {refused}"]


def _complaints(written: Any) -> dict[tuple[str, str, int], Exception]:
    """The first error of units in each line, by method, file and line."""
    errors: dict[tuple[str, str, int], Exception] = {}

    def attempt(with_units: Callable[[], Any], without: Callable[[], Any], method: str, path: str, line: int) -> Any:
        try:
            return with_units()
        except UnitError as error:
            errors.setdefault((method, path, line), error)
            return without()

    trial = _copied(written)
    for method, statements in trial.methods.items():
        for place, statement in statements:
            holder: Any = statement if isinstance(statement, (ast.Return, ast.Assign)) else statement.value
            value: ast.expr = holder.value
            key = [ast.Constant(k) for k in (method, place.source.path, place.line)]
            call = ast.Call(
                ast.Name("attempt", ast.Load()),
                [_lambda(value), _lambda(Writer.bare(deepcopy(value))), *key], [],
            )  # fmt: skip
            for node in ast.walk(call):
                node.lineno = node.end_lineno = place.line  # type: ignore[attr-defined]
                node.col_offset = node.end_col_offset = 0  # type: ignore[attr-defined]
            holder.value = call
    with suppress(ModelError, UnitError):  # of a declaration; the statements up to there are known
        _checked(class_of(trial, {"attempt": attempt}))
    return errors


def _copied(written: Any) -> Any:
    """The same statements at the same places, to be changed."""
    return replace(
        written, body=[(at, deepcopy(s)) for at, s in written.body],
        methods={name: [(at, deepcopy(s)) for at, s in lines] for name, lines in written.methods.items()},
    )  # fmt: skip


def _lambda(value: ast.expr) -> ast.expr:
    arguments = ast.arguments(posonlyargs=[], args=[], kwonlyargs=[], kw_defaults=[], defaults=[])
    return ast.Lambda(arguments, value)


def _checked(cls: type[Model]) -> None:
    """Flatten it, with its objective and constraints. Raises ModelError for units that do not fit, among others."""
    model: Any = cls()
    root: Any = flat_of(model).root
    if issubclass(cls, Optimization):
        root.objective()
        for _ in root.constraints():
            pass
