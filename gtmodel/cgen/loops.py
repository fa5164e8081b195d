"""An open body in C: loops over tables for the operations that lanes share, elimination for the linear systems."""

from __future__ import annotations

import math
from collections import defaultdict
from itertools import pairwise

import casadi as ca

from .lanes import Lanes
from .real import decimal

_UNARY = {
    ca.OP_NEG: "-{0}", ca.OP_SQ: "{0} * {0}", ca.OP_TWICE: "{0} + {0}", ca.OP_INV: "1.0 / {0}", ca.OP_SQRT: "sqrt({0})",
    ca.OP_FABS: "fabs({0})", ca.OP_SIN: "sin({0})", ca.OP_COS: "cos({0})", ca.OP_TANH: "tanh({0})",
}  # fmt: skip
_BINARY = {ca.OP_ADD: "{0} + {1}", ca.OP_SUB: "{0} - {1}", ca.OP_MUL: "{0} * {1}", ca.OP_DIV: "{0} / {1}"}
_WRITTEN = {**_UNARY, **_BINARY}

SOLVER = """\
/* LU by rows with partial pivoting, in place; places: pivot row of each step. Returns the smallest pivot. */
static double factored(double *matrix, int n, int *places)
{
    double smallest = DBL_MAX;
    int i;
    int j;
    int k;

    for (k = 0; k < n; k++) {
        double *upper = &matrix[n * k];
        double best = fabs(upper[k]);
        double inverse;
        int row = k;

        for (i = k + 1; i < n; i++) {
            const double size = fabs(matrix[(n * i) + k]);

            if (size > best) {
                best = size;
                row = i;
            }
        }
        if (best < smallest) {
            smallest = best;
        }
        places[k] = row;
        if (row != k) {
            double *other = &matrix[n * row];

            for (j = 0; j < n; j++) {
                const double t = other[j];

                other[j] = upper[j];
                upper[j] = t;
            }
        }
        inverse = 1.0 / upper[k];
        for (i = k + 1; i < n; i++) {
            double *lower = &matrix[n * i];
            const double factor = lower[k] * inverse;

            if (factor != 0.0) {
                /* two columns at a time from the end; the last pair may overwrite the entry of the factor */
                for (j = n - 2; j >= k; j -= 2) {
                    const double first = lower[j] - (factor * upper[j]);
                    const double second = lower[j + 1] - (factor * upper[j + 1]);

                    lower[j] = first;
                    lower[j + 1] = second;
                }
            }
            lower[k] = factor;
        }
    }
    return smallest;
}

/* Solves with these factors: the right-hand side x becomes the solution. */
static void solved(const double *matrix, int n, const int *places, double *x)
{
    const double *row = matrix;
    double sum;
    int j;
    int k;

    for (k = 0; k < n; k++) {
        const int place = places[k];

        if (place != k) {
            sum = x[place];
            x[place] = x[k];
            x[k] = sum;
        }
    }
    for (k = 1; k < n; k++) {
        row += n;
        sum = x[k];
        for (j = 0; j < k; j++) {
            sum -= row[j] * x[j];
        }
        x[k] = sum;
    }
    for (k = n - 1; k >= 0; k--) {
        sum = x[k];
        for (j = n - 1; j > k; j--) {
            sum -= row[j] * x[j];
        }
        x[k] = sum / row[k];
        row -= n;
    }
}

"""


def can_be_written(program: Lanes) -> bool:
    """True if every constant is finite and every operation can be written in C."""
    numbers = [node.value for node in program.nodes if node.value is not None]
    computed = [node.op for node in program.nodes if node.value is None and node.op != ca.OP_INPUT]
    return all(map(math.isfinite, numbers)) and all(op in _WRITTEN for op in computed)


def loop_text(symbol: str, program: Lanes) -> str:
    """Return the text of the C function `symbol`, with its tables."""
    return _Text(symbol, program).text()


class _Text:
    """Text of one function. Its array w holds the values that a loop stores for other loops, one row for each lane."""

    def __init__(self, symbol: str, program: Lanes) -> None:
        self.symbol, self.program, self.body = symbol, program, program.body
        self.columns: dict[tuple[float, ...], int] = {}  # columns of the table of numbers
        self.rows: dict[tuple[int, ...], int] = {}  # rows of the table of places
        self.work: dict[object, int] = {}  # columns of w: groups and gathered operands
        self.placed = self._places()
        self.stored = self._stored()

    def text(self) -> str:
        body, program = self.body, self.program
        steps = self._steps()
        lanes, symbol = program.count, self.symbol
        tables = ""
        if self.columns:
            rows = [", ".join(decimal(column[k]) for column in self.columns) for k in range(lanes)]
            tables += f"static const double {symbol}_numbers[{lanes}][{len(self.columns)}] = {{\n"
            tables += "".join(f"    {{{row}}},\n" for row in rows) + "};\n"
        if self.rows:
            tables += f"static const int {symbol}_places[{len(self.rows)}][{lanes}] = {{\n"
            tables += "".join(f"    {{{', '.join(map(str, row))}}},\n" for row in self.rows) + "};\n"
        arguments = [f"i{k}[{body.function.numel_in(k)}]" for k in range(body.arguments)]
        results = [f"o{k}[{size}]" for k, size in enumerate(body.outputs)]
        systems = body.different
        declared = [f"double w[{lanes}][{max(1, len(self.work))}];", "int k;"]
        declared += [f"double x{k}[{size}];" for k, size in enumerate(body.sizes)]
        declared += [f"double m{k}[{body.sizes[k] ** 2}];" for k in systems]
        declared += [f"double least{k};" for k in systems] + [f"int places{k}[{body.sizes[k]}];" for k in systems]
        lines = [*declared, "", "(void)iw;", "(void)scratch;", "(void)mem;", *steps, "return 0;"]
        return (
            f"{tables}\n/* {symbol}:({','.join(arguments)})->({','.join(results)}) */\n"
            f"int {symbol}(const double **arg, double **res, long long int *iw, double *scratch, int mem)\n{{\n"
            + "".join(f"    {line}\n" if line else "\n" for line in lines)
            + "}\n"
        )

    def _steps(self) -> list[str]:
        program, body = self.program, self.body
        singles: dict[int, list[int]] = defaultdict(list)
        loops: dict[tuple[int, tuple[int, ...]], list[tuple[str, int]]] = defaultdict(list)
        for (kind, n), level in program.level.items():
            if kind == "node":
                singles[level].append(n)
            else:
                loops[level, program.groups[n].lanes if kind == "group" else program.chains[n].lanes].append((kind, n))
        behind = {k: program.solved_at(k) for k in range(len(body.sizes))}
        lines: list[str] = []
        for level in range(max([*program.level.values(), *behind.values()], default=0) + 1):
            for n in sorted(singles[level]):
                lines += self._alone(n)
            for (_, lanes), units in sorted((key, units) for key, units in loops.items() if key[0] == level):
                lines += self._loop(lanes, units)
            for k in [k for k, last in behind.items() if last == level]:
                lines += self._system(k)
        for k, size in enumerate(body.outputs):
            computed = body.function.numel_out(k)
            lines += [f"res[{k}][{n}] = {self._value(program.outputs[k, n])};" for n in range(computed)]
            pivots = iter(body.different)
            lines += [f"res[{k}][{n}] = least{next(pivots)};" for n in range(computed, size)]
        return lines

    def _places(self) -> dict[int, list[tuple[str, tuple[int, ...]]]]:
        """Return for each group the entries of matrices and right-hand sides that its values fill, by lane."""
        program, body = self.program, self.body
        targets = [(f"m{k}", program.matrix(k)) for k in body.different]
        targets += [(f"x{k}", program.right(k)) for k in range(len(body.sizes))]
        placed: dict[int, list[tuple[str, tuple[int, ...]]]] = defaultdict(list)
        for name, nodes in targets:
            where: dict[int, list[int]] = defaultdict(list)
            for place, n in enumerate(nodes):
                where[n].append(place)
            for g, group in enumerate(program.groups):
                of_lane = [where.get(n, []) for n in group.nodes.values()]
                for row in zip(*of_lane, strict=False):
                    placed[g].append((name, row))
        return placed

    def _stored(self) -> set[int]:
        """Return the groups that are read outside of their loop."""
        program = self.program
        outside: set[int] = set()
        written = {(name, place) for rows in self.placed.values() for name, row in rows for place in row}
        systems = [(f"m{k}", program.matrix(k)) for k in self.body.different]
        systems += [(f"x{k}", program.right(k)) for k in range(len(self.body.sizes))]
        for name, nodes in systems:
            outside |= {n for place, n in enumerate(nodes) if (name, place) not in written}
        outside |= {n for (k, _), n in program.outputs.items() if k <= self.body.targets}
        for unit, level in program.level.items():
            kind, n = unit
            if kind == "node":
                outside |= set(program.nodes[n].reads)
            elif kind == "chain":
                chain = program.chains[n]
                outside |= {chain.start, *[m for _, g in chain.terms for m in program.groups[g].nodes.values()]}
            else:
                for lane, m in program.groups[n].nodes.items():
                    for c in program.nodes[m].reads:
                        source = program.unit(c)
                        if not self._local(source, level, program.groups[n].lanes) or program.lane_of[c] != lane:
                            outside.add(c)
        return {program.group_of[n] for n in outside if n in program.group_of}

    def _local(self, unit: tuple[str, int], level: int, lanes: tuple[int, ...]) -> bool:
        """True if a loop over these lanes at this level computes the unit."""
        return unit[0] == "group" and self.program.level[unit] == level and self.program.groups[unit[1]].lanes == lanes

    def _column(self, key: object) -> int:
        return self.work.setdefault(key, len(self.work))

    def _value(self, n: int) -> str:
        """Return the C expression of a node outside of loops."""
        program, node = self.program, self.program.nodes[n]
        if node.value is not None:
            return decimal(node.value) if node.value >= 0 else f"({decimal(node.value)})"
        if n in program.chain_of:
            return f"s{program.chain_of[n]}"
        if n in program.group_of:
            return f"w[{program.lane_of[n]}][{self._column(program.group_of[n])}]"
        system = node.place[0] - self.body.arguments
        return f"x{system}[{node.place[1]}]" if node.op == ca.OP_INPUT and system >= 0 else f"a{n}"

    def _alone(self, n: int) -> list[str]:
        node = self.program.nodes[n]
        if node.op == ca.OP_INPUT:
            argument, entry = node.place
            return [f"const double a{n} = arg[{argument}][{entry}];"] if argument < self.body.arguments else []
        return [f"const double a{n} = {_WRITTEN[node.op].format(*map(self._value, node.reads))};"]

    def _loop(self, lanes: tuple[int, ...], units: list[tuple[str, int]]) -> list[str]:
        program = self.program
        before: list[str] = []
        inside: list[str] = []
        groups = sorted((n for kind, n in units if kind == "group"), key=lambda n: program.groups[n].nodes[lanes[0]])
        level = program.level[units[0]]
        for g in self._in_order(groups):
            nodes = program.groups[g].nodes
            first = program.nodes[nodes[lanes[0]]]
            parts = []
            for k in range(len(first.reads)):
                part, gathered = self._operand(tuple(program.nodes[nodes[x]].reads[k] for x in lanes), lanes, level)
                parts.append(part)
                before += gathered
            inside.append(f"const double v{g} = {_WRITTEN[first.op].format(*parts)};")
            if g in self.stored:
                inside.append(f"w[k][{self._column(g)}] = v{g};")
            inside += [f"{name}[{self._place(row, lanes)}] = v{g};" for name, row in self.placed.get(g, [])]
        for c in [n for kind, n in units if kind == "chain"]:
            chain = program.chains[c]
            before.append(f"double s{c} = {self._value(chain.start)};")
            for op, g in chain.terms:
                sign = "+" if op == ca.OP_ADD else "-"
                inside.append(f"s{c} {sign}= w[k][{self._column(g)}];")
        table = [f"const double *const c = {self.symbol}_numbers[k];"] if any("c[" in x for x in inside) else []
        head = f"for (k = {lanes[0]}; k < {lanes[-1] + 1}; k++) {{"
        return [*before, head, *[f"    {line}" for line in [*table, *inside]], "}"]

    def _in_order(self, groups: list[int]) -> list[int]:
        """Sort the groups of a loop so that each comes after its operands."""
        program, inside, order = self.program, set(groups), dict[int, None]()

        def visit(g: int) -> None:
            if g not in order:
                for m in program.groups[g].nodes.values():
                    for c in program.nodes[m].reads:
                        if program.group_of.get(c, g) != g and program.group_of[c] in inside:
                            visit(program.group_of[c])
                order[g] = None

        for g in groups:
            visit(g)
        return list(order)

    def _operand(self, nodes: tuple[int, ...], lanes: tuple[int, ...], level: int) -> tuple[str, list[str]]:
        """Return the C expression of an operand of the lanes, and the statements that must precede the loop."""
        program = self.program
        if all(program.is_number(n) for n in nodes):
            values = [program.nodes[n].value or 0.0 for n in nodes]
            if len(set(values)) == 1:
                return self._value(nodes[0]), []
            of_lane = dict(zip(lanes, values, strict=True))
            column = tuple(of_lane.get(k, 0.0) for k in range(program.count))
            return f"c[{self.columns.setdefault(column, len(self.columns))}]", []
        if len(set(nodes)) == 1:
            return self._value(nodes[0]), []
        groups = {program.group_of.get(n, -1) for n in nodes}
        if len(groups) == 1 and -1 not in groups and [program.lane_of[n] for n in nodes] == list(lanes):
            g = groups.pop()
            return (f"v{g}" if self._local(("group", g), level, lanes) else f"w[k][{self._column(g)}]"), []
        new = nodes not in self.work
        column = self._column(nodes)
        fill = [f"w[{x}][{column}] = {self._value(n)};" for x, n in zip(lanes, nodes, strict=True)]
        return f"w[k][{column}]", fill if new else []

    def _place(self, row: tuple[int, ...], lanes: tuple[int, ...]) -> str:
        """Return the C index of the entry that a lane fills: in equal steps, or from the table of places."""
        steps = {b - a for a, b in pairwise(row)}
        if len(steps) == 1:
            step = steps.pop()
            first = row[0] - step * lanes[0]
            times = "k" if step == 1 else f"({step} * k)"
            return f"{times} + {first}" if first > 0 else f"{times} - {-first}" if first else times
        least = min(row)
        of_lane = dict(zip(lanes, [r - least for r in row], strict=True))
        column = tuple(of_lane.get(k, 0) for k in range(self.program.count))
        table = f"{self.symbol}_places[{self.rows.setdefault(column, len(self.rows))}][k]"
        return f"{table} + {least}" if least else table

    def _system(self, k: int) -> list[str]:
        """Return the statements that solve a system; a matrix that several systems share is factored once."""
        program, size, first = self.program, self.body.sizes[k], self.body.shared[k]
        written = {(name, place) for rows in self.placed.values() for name, row in rows for place in row}
        lines = []
        if first == k:
            entries = enumerate(program.matrix(k))
            lines += [f"m{k}[{n}] = {self._value(e)};" for n, e in entries if (f"m{k}", n) not in written]
            lines.append(f"least{k} = factored(m{k}, {size}, places{k});")
        entries = enumerate(program.right(k))
        lines += [f"x{k}[{n}] = {self._value(e)};" for n, e in entries if (f"x{k}", n) not in written]
        return [*lines, f"solved(m{first}, {size}, places{first}, x{k});"]
