"""The derivatives of a causal function by its inputs as a causal function of its own, for C."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca

from ..compiler.causal import CausalFunction, CausalSignal, c_name
from ..compiler.derivative import depends
from ..compiler.evaluate import Built, guarded

UNITLESS = ("", "1", "?")


def jacobian_function(f: CausalFunction) -> CausalFunction:
    """Return the derivatives of the targets of a causal function by its inputs, as a causal function of its own.

    One result for each target and each input that it depends on, named T_by_q, with the entries of the target along the
    first axes. Guards and statuses are those of `f`, and a derivative must be finite. Unknowns of Newton blocks are
    differentiated by their equations.

    >>> fk = gt.robots.gantry_tau("l1_tape").causal(known="q", targets="T")
    >>> T_by_q, status = gt.cgen.jacobian_function(fk)([-0.7, -0.8, -0.6])
    >>> T_by_q.shape, bool(np.allclose(T_by_q, fk.jacobian([-0.7, -0.8, -0.6])[0]))
    ((3, 3), True)
    """
    return DerivativeFunction(f)


def renamed(f: CausalFunction, name: str) -> CausalFunction:
    """Return the same function, built again under another name."""
    if isinstance(f, DerivativeFunction):
        return DerivativeFunction(renamed(f.of, name))
    return CausalFunction(f.plan, f.inputs, f.outputs, name)


class DerivativeFunction(CausalFunction):
    """Derivatives of the targets of a causal function by its inputs; see `jacobian_function`.

    Unknowns of Newton blocks follow their equations: dz = -(dr/dz)^-1 dr/da.
    """

    def __init__(self, f: CausalFunction) -> None:
        needed, row = depends(f), 0
        self.blocks: list[tuple[int, int, int]] = []  # target, first and last input
        outputs = []
        for n, t in enumerate(f.outputs):
            used, column = set().union(*needed[row : row + t.size]), 0
            for i in f.inputs:
                if used & set(range(column, column + i.size)):
                    name, pairs = f"{c_name(t.name)}_by_{c_name(i.name)}", tuple(p for p in t.pairs for _ in i.pairs)
                    outputs.append(CausalSignal(name, (*t.shape, *i.shape), _unit(t.unit, i.unit), pairs))
                    self.blocks.append((n, column, column + i.size))
                column += i.size
            row += t.size
        super().__init__(f.plan, f.inputs, outputs, f.name, f.groups, f.preferred, f.branches)
        self.of = f

    @cached_property
    def _built(self) -> Built:
        of, kernels = self.of.closed, self.of.kernels
        args = of.sx_in()
        *targets, margins = of.call(args)
        zs = args[len(args) - len(kernels) :]
        residuals = []
        for k, (kernel, z) in enumerate(zip(kernels, zs, strict=True)):
            before = ca.vertcat(*args[: len(args) - len(kernels)], *zs[:k])
            residuals.append(kernel.residual.call([z, before])[0])
        results = [*self.derived(targets, residuals, args[: len(self.inputs)], zs), margins]
        names = [s.name for s in self.outputs] + ["margins"]
        closed = ca.Function(of.name(), args, ca.cse(results), of.name_in(), names)
        count = len(args) - len(kernels)
        names_out = [*names[:-1], "status", "margins"]
        whole = guarded(
            closed, kernels, self.margins, self.sizes, self.of.casadi.name(), of.name_in()[:count], names_out
        )
        return Built(closed, kernels, whole)

    def derived(
        self, targets: Sequence[ca.SX], residuals: Sequence[ca.SX], inputs: Sequence[ca.SX], zs: Sequence[ca.SX]
    ) -> list[ca.SX]:
        """Return the results as columns, by rows of each matrix, from those of the function and of its blocks."""
        x, moved = ca.vertcat(ca.SX(0, 1), *inputs), ca.SX(0, sum(i.numel() for i in inputs))
        for k, (r, z) in enumerate(zip(residuals, zs, strict=True)):
            slope = ca.jacobian(r, x) + ca.mtimes(ca.jacobian(r, ca.vertcat(ca.SX(0, 1), *zs[:k])), moved)
            moved = ca.vertcat(moved, -ca.solve(ca.jacobian(r, z), ca.densify(slope)))
        full = [ca.jacobian(t, x) + (ca.mtimes(ca.jacobian(t, ca.vertcat(*zs)), moved) if zs else 0) for t in targets]
        return [ca.densify(ca.vec(full[n][:, first:last].T)) for n, first, last in self.blocks]


def _unit(target: str, by: str) -> str:
    """Unit of a derivative."""
    if by in UNITLESS:
        return target
    (base, order), (base_by, order_by) = _rate(target), _rate(by)
    if base == base_by:
        k = order - order_by
        seconds = "s" if abs(k) == 1 else f"s{abs(k)}"
        return "1" if k == 0 else f"1/{seconds}" if k > 0 else seconds
    by = f"({by})" if "/" in by or "." in by else by
    return f"{'1' if target in UNITLESS else target}/{by}"


def _rate(unit: str) -> tuple[str, int]:
    """Unit without its seconds below, and their power: m/s2 -> m, 2."""
    base, slash, below = unit.rpartition("/s")
    return (base, int(below or 1)) if slash and (not below or below.isdigit()) else (unit, 0)
