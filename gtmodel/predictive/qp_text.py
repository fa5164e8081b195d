"""C text of a `StageQP` inside a step function: its table, its working memory, and the call of gt_stage_qp.h."""

from __future__ import annotations

import casadi as ca

from ..cgen.real import DOUBLE, Real, decimal
from .interior_point import enough
from .kernels import KERNELS, gains_of, ranges
from .stage_qp import StageQP

NAMES = ("stage", "last")


class QPText:
    """Text for one program; `symbol`: prefix of its C names; `real`: their number type."""

    def __init__(self, qp: StageQP, symbol: str, real: Real = DOUBLE) -> None:
        self.qp, self.symbol, self.tolerance = qp, symbol, qp.tolerance_in(real)
        self.enough = enough(self.tolerance, real)
        self.own, self.end = qp.stage.positives, qp.last.positives
        self.sides = qp.count * self.own + self.end

    def kernels(self) -> list[ca.Function]:
        """Return the operations of a stage and of the last one under their C names."""
        return [
            called(f[k], f"{self.symbol}_{name}_{k}") for f, name in zip(self.qp.kernels, NAMES, strict=True) for k in f
        ]

    def table(self) -> str:
        """Return the constants that describe the program."""
        qp, symbol = self.qp, self.symbol
        n, m = qp.stage.states, qp.stage.inputs
        tables, heads = [], []
        for name, of in zip(NAMES, (qp.stage, qp.last), strict=True):
            prices, across = [p for s in of.sides if s.price for p in s.price], ranges(of)
            tables += [
                _array("int", f"{symbol}_{name}_first", [str(first) for first, _ in across]),
                _array("int", f"{symbol}_{name}_size", [str(size) for _, size in across]),
                _array("int", f"{symbol}_{name}_row", [str(s.row) for s in of.sides]),
                _array("double", f"{symbol}_{name}_sign", [decimal(s.sign) for s in of.sides]),
                _array("double", f"{symbol}_{name}_price", [decimal(p) for p in prices]),
            ]
            numbers = [of.numbers, len(of.rows), len(of.sides), len(of.soft), of.positives]
            numbers += [sum(size for _, size in across)]
            names = [f"{symbol}_{name}_{k}" for k in ("first", "size", "row", "sign", "price")]
            names += [f"{symbol}_{name}_{k}" for k in KERNELS]
            heads.append(f"{{{', '.join([*map(str, numbers), *names])}}}")
        given = [f"{qp.count}, {n}, {m}, {gains_of(n, m)}, {qp.max_iterations}"]
        given += [f"{decimal(max(self.sides // 2, 1))}, {decimal(self.tolerance)}, {decimal(self.enough)}", *heads]
        inner = ",\n    ".join(given)
        return f"{''.join(tables)}static const gt_stage_qp {symbol}_qp = {{\n    {inner}\n}};\n\n"

    def memory(self) -> tuple[str, str]:
        """Return the declarations of the arrays, and the statements that point to them."""
        qp, sides = self.qp, self.sides
        n, m, count, stage, last = qp.stage.states, qp.stage.inputs, qp.count, qp.stage, qp.last
        rows, limits, soft = (
            count * len(a) + len(b)
            for a, b in ((stage.rows, last.rows), (stage.sides, last.sides), (stage.soft, last.soft))
        )
        sizes = {
            "limits": limits, "excesses": soft, "bound": max(len(stage.sides), len(last.sides)), "sides": sides,
            "x": (count + 1) * n, "u": count * m, "dx": (count + 1) * n, "du": count * m, "y": rows, "dy": rows,
            "weight": rows, "slope": rows, "by_x": (count + 1) * n, "by_u": count * m,
            "entries": sum(a * sum(size for _, size in ranges(s)) for a, s in ((count, stage), (1, last))),
            "gain": count * gains_of(n, m), "offset": count * m, "inverse": count * m, "part": m,
            "hessian": (n + m) * (n + m + 1), "gradient": 2 * n,
        }  # fmt: skip
        of = {"limits": "gt_stage_qp_limit", "excesses": "gt_stage_qp_excess"}
        arrays = "".join(f"    {of.get(k, 'double')} {k}[{max(1, size)}];\n" for k, size in sizes.items())
        return arrays, "".join(f"    work.{k} = {k};\n" for k in sizes)


def _array(of: str, name: str, entries: list[str]) -> str:
    return f"static const {of} {name}[{max(1, len(entries))}] = {{{', '.join(entries or ['0'])}}};\n"


def called(f: ca.Function, name: str) -> ca.Function:
    """Return the function under another name."""
    symbols = f.sx_in()
    return ca.Function(name, symbols, f.call(symbols))


def init_text(symbol: str, copied: str = "", refused: str = "") -> str:
    """Return the C text of an init that empties the state and then runs `copied`."""
    unused = "" if copied else "    (void)start;\n"
    return (
        f"gt_status {symbol}_init({symbol}_state *state, const {symbol}_start *start)\n{{\n"
        f"    static const {symbol}_state empty = {{0}};\n\n{unused}{refused}    *state = empty;\n{copied}"
        "    return GT_OK;\n}\n\n"
    )
