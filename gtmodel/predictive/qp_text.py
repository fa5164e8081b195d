"""C text of a `StageQP` inside a step function: its table, its working memory, and the call of gt_stage_qp.h."""

from __future__ import annotations

import casadi as ca

from ..cgen.real import decimal
from .kernels import KERNELS
from .stage_qp import StageQP

NAMES = ("stage", "last")


class QPText:
    """Text for one program; `symbol`: prefix of its C names."""

    def __init__(self, qp: StageQP, symbol: str, tolerance: float) -> None:
        self.qp, self.symbol, self.tolerance = qp, symbol, tolerance
        self.own, self.end = qp.stage.positives, qp.last.positives
        self.sides = qp.count * self.own + self.end

    def kernels(self) -> list[ca.Function]:
        """Return the operations of a stage and of the last one under their C names."""
        return [
            called(f[k], f"{self.symbol}_{name}_{k}")
            for f, name in zip(self.qp.kernels, NAMES, strict=True)
            for k in KERNELS
        ]

    def table(self) -> str:
        """Return the constant that describes the program."""
        qp, symbol = self.qp, self.symbol
        n, m = qp.stage.states, qp.stage.inputs
        heads = []
        for name, of in zip(NAMES, (qp.stage, qp.last), strict=True):
            numbers = [of.numbers, len(of.rows), of.positives, of.positives // 2]
            heads.append(f"{{{', '.join([*map(str, numbers), *[f'{symbol}_{name}_{k}' for k in KERNELS]])}}}")
        given = [f"{qp.count}, {n}, {m}, {n * (n + 1) // 2}, {m * (m - 1) // 2}, {qp.max_iterations}"]
        given += [f"{decimal(max(self.sides // 2, 1))}, {decimal(self.tolerance)}", *heads]
        inner = ",\n    ".join(given)
        return f"static const gt_stage_qp {symbol}_qp = {{\n    {inner}\n}};\n\n"

    def memory(self) -> tuple[str, str]:
        """Return the declarations of the arrays, and the statements that point to them."""
        qp, sides = self.qp, self.sides
        n, m, count, stage, last = qp.stage.states, qp.stage.inputs, qp.count, qp.stage, qp.last
        rows, products = count * len(stage.rows) + len(last.rows), sides // 2
        part = max(m, self.own // 2, self.end // 2)
        sizes = {
            "x": (count + 1) * n, "u": count * m, "du": count * m, "y": rows, "sides": sides, "change": sides,
            "product": products, "weight": rows, "slope": rows, "gain": count * m * n, "offset": count * m,
            "lower": count * m * (m - 1) // 2, "inverse": count * m, "part": part, "hessian": n * (n + 1),
            "gradient": 2 * n, "dx": 2 * n, "dy": max(len(stage.rows), len(last.rows)),
        }  # fmt: skip
        arrays = "".join(f"    double {k}[{max(1, size)}];\n" for k, size in sizes.items())
        return arrays, "".join(f"    work.{k} = {k};\n" for k in sizes)


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
