"""Units of a text: lines with inconsistent units are reported and lose their units, all others are checked."""

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

# most declarations that lose their units, one after another
MOST = 50


def fitted(flat: Flattened) -> tuple[type[Model], bool, list[str]]:
    """Return the Python class of a flattened class, whether it has units, and warnings about units.

    An equation or declaration with inconsistent units loses its units; the others keep theirs. `flat.bare` and
    `flat.without_unit` record these lines for later calls of the Writer.
    """
    if not any(f.get("unit") for f in flat.flats):
        return class_of(Writer(flat, exact, units=False).write()), False, []
    warnings: list[str] = []
    fault: Exception | None = None
    for _ in range(MOST):
        writer = Writer(flat, exact, units=True)
        written = writer.write()
        cls = class_of(written)
        try:
            _checked(cls)
        except (ModelError, UnitError) as error:
            fault = error
        else:
            return cls, True, [*writer.warnings, *dict.fromkeys(warnings)]
        if not isinstance(fault, UnitError):
            break  # the error is reported when the class is used
        errors = _complaints(written)
        flat.bare |= set(errors)
        warnings += [f"units not checked: {error}" for error in errors.values()]
        if not errors:
            variables = {id(f) for f in flat.flats if f.at.where == getattr(fault, "where", None)} - flat.without_unit
            if not variables:
                break
            flat.without_unit |= variables
            warnings.append(f"unit ignored: {fault}")
    plain = class_of(Writer(flat, exact, units=False).write())
    try:
        _checked(plain)
    except (ModelError, UnitError):
        return plain, False, []  # the error is reported when the class is used
    return plain, False, [f"units are not used: {fault}"]


def _complaints(written: Any) -> dict[tuple[str, str, int], Exception]:
    """Return the first unit error of each line, by method, file and line."""
    errors: dict[tuple[str, str, int], Exception] = {}

    def attempt(with_units: Callable[[], Any], without: Callable[[], Any], method: str, path: str, line: int) -> Any:
        try:
            return with_units()
        except UnitError as error:
            errors.setdefault((method, path, line), error)
            return without()

    instrumented = _copied(written)
    for method, statements in instrumented.methods.items():
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
    with suppress(ModelError, UnitError):  # an error of a declaration ends it; the errors before are known
        _checked(class_of(instrumented, {"attempt": attempt}))
    return errors


def _copied(written: Any) -> Any:
    """Return a deep copy of the statements, to be changed."""
    return replace(
        written, body=[(at, deepcopy(s)) for at, s in written.body],
        methods={name: [(at, deepcopy(s)) for at, s in lines] for name, lines in written.methods.items()},
    )  # fmt: skip


def _lambda(value: ast.expr) -> ast.expr:
    arguments = ast.arguments(posonlyargs=[], args=[], kwonlyargs=[], kw_defaults=[], defaults=[])
    return ast.Lambda(arguments, value)


def _checked(cls: type[Model]) -> None:
    """Flatten a class with its objective and constraints. Raises ModelError or UnitError, also for other faults."""
    model: Any = cls()
    root: Any = flat_of(model).root
    if issubclass(cls, Optimization):
        root.objective()
        for _ in root.constraints():
            pass
