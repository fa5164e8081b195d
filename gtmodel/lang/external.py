"""Functions from elsewhere inside equations: a ca.Function with the units of its arguments and values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from .expression import Expr, Shape, gathered, operand, scope_of
from .source import ModelError, here
from .units import parse_unit


class External:
    """A function declared by `external`; a call inside `equations` returns expressions."""

    def __init__(self, function: ca.Function, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> None:
        self.function, self.inputs, self.outputs = function, inputs, outputs
        self.name = function.name()
        self._written = _written_out(function)

    @property
    def opaque(self) -> bool:
        """Whether the function stays a call in the equations, because CasADi cannot write out its operations."""
        return self._written is None

    def __repr__(self) -> str:
        return f"gt.external({self.name}: {', '.join(self.inputs)} -> {', '.join(self.outputs)})"

    def __reduce__(self) -> tuple[Any, ...]:
        return External, (self.function, self.inputs, self.outputs)

    def __call__(self, *arguments: Any) -> Any:
        """Return the value as an expression, or a tuple of them if the function has several outputs.

        Numbers among the arguments are in SI units. Raises ModelError for another number of arguments, for an argument
        of another shape or unit, and if no argument is an expression.
        """
        f = self.function
        if len(arguments) != f.n_in():
            raise ModelError(f"{self.name}() takes {f.n_in()} arguments; found {len(arguments)}", here())
        scope = scope_of(*(gathered(a) for a in arguments))
        if scope is None:
            raise ModelError(
                f"{self.name}() needs at least one expression of the model; for numbers call the ca.Function", here()
            )
        columns = []
        for k, argument in enumerate(map(gathered, arguments)):
            sx, shape = operand(argument, scope)
            unit, expected = parse_unit(self.inputs[k]), _shape(f.size_in(k))
            what = f"argument '{f.name_in(k)}' of {self.name}()"
            if shape != expected:
                raise ModelError(f"{what} has shape {shape}; expected {expected}", here())
            dimension = argument.dimension if isinstance(argument, Expr) else None
            if dimension is not None and dimension != unit.dimension:
                raise ModelError(f"{what} is in {dimension}; expected {self.inputs[k]}", here())
            columns.append(sx if unit.is_si else sx / unit.scale)
        if self._written is None and f not in scope.calls:
            scope.calls.append(f)
        values = (self._written or f).call(columns)
        results = []
        for k, value in enumerate(values):
            unit, sx = parse_unit(self.outputs[k]), ca.densify(ca.SX(value))
            results.append(Expr(sx if unit.is_si else sx * unit.scale, _shape(f.size_out(k)), unit.dimension, scope))
        return results[0] if len(results) == 1 else tuple(results)


def external(function: ca.Function, inputs: Sequence[str], outputs: Sequence[str]) -> External:
    """Declare a function written with CasADi, or in another language, for use in equations.

    Args:
        function: a ca.Function with derivatives. Inputs and outputs of size (n, 1) are vectors (n,), of size (1, 1)
            scalars, others matrices.
        inputs: unit of each input, "1" if it has none. Scaled units such as "mm" or "deg" are converted from and to SI.
        outputs: unit of each output.

    If CasADi can write out the function's operations (all of an SX function, most MX functions), they become part of
    the equations, and everything that gtmodel does with equations holds for them, C included. Otherwise (ca.external,
    ca.interpolant, ca.Callback, a solver) the function stays a call: `opaque` is then true. Such models can be solved,
    simulated, linearised and optimised. They become C in double if CasADi writes the C of the function, as for a table
    or an MX function that is not inlined, not for a callback, a solver or a library. Where gtmodel must rewrite an
    expression with such a call, as beside gt.sign, a ModelError asks for a variable and an equation of its own.

    Declare the function once, outside the class or in its body; another function, even with equal content, makes
    another model. Raises ModelError if the number of units differs from the number of inputs or outputs, for an unknown
    unit, and for a function without derivatives.

    >>> import casadi as ca
    >>> x = ca.MX.sym("x")
    >>> cam = ca.Function("cam", [x], [0.02 * ca.sin(x) ** 2])
    >>> lift_of = gt.external(cam, inputs=["rad"], outputs=["m"])
    >>> class Cam(gt.Model):
    ...     phi = gt.variable(unit="rad")
    ...     lift = gt.variable(unit="m")
    ...     def equations(self):
    ...         yield self.lift == lift_of(self.phi)
    >>> lift, status = Cam().causal(known="phi", targets="lift")(1.0)
    >>> round(lift, 6)
    0.014161
    """
    if not isinstance(function, ca.Function):
        raise ModelError(f"gt.external takes a ca.Function; found {type(function).__name__} {function!r}", here())
    name = function.name()
    for what, units, count in (("inputs", inputs, function.n_in()), ("outputs", outputs, function.n_out())):
        if isinstance(units, str) or len(units) != count:
            given = f"'{units}'" if isinstance(units, str) else f"{len(units)}"
            raise ModelError(f"gt.external: {name} has {count} {what}; expected as many units, found {given}", here())
        for unit in units:
            try:
                parse_unit(unit)
            except ValueError as error:
                raise ModelError(f"gt.external: {what} of {name}: {error}", here()) from None
    result = External(function, tuple(inputs), tuple(outputs))
    if result.opaque:
        try:
            function.jacobian()
        except RuntimeError:
            raise ModelError(
                f"gt.external: {name} has no derivatives; give its ca.Function a Jacobian (for a ca.Callback "
                "get_jacobian, or the option enable_fd)",
                here(),
            ) from None
    return result


def _written_out(function: ca.Function) -> ca.Function | None:
    """Return the function as operations on scalars; None if CasADi cannot write out a part of it."""
    try:
        written = function.expand()
    except RuntimeError:
        return None
    calls = any(written.instruction_id(k) == ca.OP_CALL for k in range(written.n_instructions()))
    return None if calls else written


def _shape(size: tuple[int, int]) -> Shape:
    rows, columns = size
    return (rows, columns) if columns != 1 else (rows,) if rows != 1 else ()
