"""Equal operations on equal parts, found in the instructions of an open body: a lane is one of the parts.

The operands of an operation determine its level. Even levels hold single statements, odd levels loops over the lanes.
An operation reads values of lower levels and, inside a loop, values of its own lane.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import casadi as ca

from .open_body import FEWEST, OpenBody

# operations on constants, as CasADi's virtual machine computes them
_NUMBERS: dict[int, Callable[..., float]] = {
    ca.OP_ADD: lambda x, y: x + y,
    ca.OP_SUB: lambda x, y: x - y,
    ca.OP_MUL: lambda x, y: x * y,
    ca.OP_NEG: lambda x: -x,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_TWICE: lambda x: x + x,
}
_CHAINED = (ca.OP_ADD, ca.OP_SUB)

Key = tuple[object, ...]
Depth = tuple[int, int]


@dataclass(frozen=True)
class Node:
    """An operation on earlier nodes. place: argument and entry of an input. value: of a constant."""

    op: int
    reads: tuple[int, ...] = ()
    place: tuple[int, int] = (-1, -1)
    value: float | None = None


@dataclass
class Group:
    """The same operation in several lanes: the node of each lane, in their order."""

    nodes: dict[int, int]

    @property
    def lanes(self) -> tuple[int, ...]:
        return tuple(self.nodes)


@dataclass
class LaneSum:
    """A sum over lanes, node by node. Each lane adds or subtracts its node of the same groups, in the same order."""

    start: int
    lanes: tuple[int, ...]
    nodes: list[int]
    terms: list[tuple[int, int]]  # operation and group of each term of a lane


@dataclass
class Lanes:
    """The nodes of a body, its outputs by (result, entry), and its groups and chains over lanes."""

    body: OpenBody
    nodes: list[Node] = field(default_factory=list)
    outputs: dict[tuple[int, int], int] = field(default_factory=dict)
    groups: list[Group] = field(default_factory=list)
    chains: list[LaneSum] = field(default_factory=list)
    group_of: dict[int, int] = field(default_factory=dict)
    lane_of: dict[int, int] = field(default_factory=dict)
    chain_of: dict[int, int] = field(default_factory=dict)
    level: dict[tuple[str, int], int] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of lanes."""
        return 1 + max(lane for _, lane in self.body.lanes)

    def matrix(self, k: int) -> list[int]:
        """Return the nodes of the matrix of a system, by rows."""
        return [self.outputs[self.body.targets + 1 + k, n] for n in range(self.body.sizes[k] ** 2)]

    def right(self, k: int) -> list[int]:
        """Return the nodes of the right-hand side of a system."""
        first = self.body.targets + 1 + len(self.body.sizes)
        return [self.outputs[first + k, n] for n in range(self.body.sizes[k])]

    def is_number(self, n: int) -> bool:
        return self.nodes[n].value is not None

    def unit(self, n: int) -> tuple[str, int]:
        """Return the unit that computes a node: a group, a chain, or the node itself."""
        if n in self.chain_of:
            return "chain", self.chain_of[n]
        return ("group", self.group_of[n]) if n in self.group_of else ("node", n)

    def solved_at(self, k: int) -> int:
        """Return the level after which a system is solved."""
        needed = [*self.matrix(self.body.shared[k]), *self.right(k)]
        levels = [self.level_of(self.unit(n)) for n in needed if not self.is_number(n)]
        return max([*levels, self.solved_at(self.body.shared[k]) if self.body.shared[k] != k else 0])

    def level_of(self, unit: tuple[str, int]) -> int:
        """Return the level of a group, a chain or a node."""
        if unit not in self.level:
            self.level[unit] = self._level(*unit)
        return self.level[unit]

    def _level(self, kind: str, n: int) -> int:
        if kind == "node":
            node = self.nodes[n]
            if node.op == ca.OP_INPUT:
                system = node.place[0] - self.body.arguments
                return _even(self.solved_at(system) + 1) if system >= 0 else 0
            return max([_even(self.level_of(self.unit(c))) for c in self._computed(node.reads)], default=0)
        if kind == "chain":
            chain = self.chains[n]
            before = [chain.start, *[m for _, g in chain.terms for m in self.groups[g].nodes.values()]]
            return max(_odd(self.level_of(self.unit(c)) + 1) for c in self._computed(before))
        lanes, least = self.groups[n].lanes, 1
        for m in self.groups[n].nodes.values():
            for c in self._computed(self.nodes[m].reads):
                source = self.unit(c)
                same = (
                    source[0] == "group"
                    and self.groups[source[1]].lanes == lanes
                    and self.lane_of[c] == self.lane_of[m]
                )
                least = max(least, self.level_of(source) if same else _odd(self.level_of(source) + 1))
        return least

    def _computed(self, nodes: Iterable[int]) -> list[int]:
        return [c for c in nodes if not self.is_number(c)]


def _even(level: int) -> int:
    return level + level % 2


def _odd(level: int) -> int:
    return level + 1 - level % 2


def lanes_of(body: OpenBody) -> Lanes:
    """Return the operations of a body, sorted by lanes."""
    program = Lanes(body)
    keys, lane = _read(program)
    live = _live(program)
    depth = _depths(program, live)
    _group(program, keys, lane, depth)
    _chain(program, live)
    for n in sorted(live, key=depth.__getitem__):
        program.level_of(program.unit(n))
    _sink(program, live)
    return program


def _sink(program: Lanes, live: set[int]) -> None:
    """Move groups that only one later loop reads into this loop, so that their values need not be stored."""
    readers: dict[int, list[int]] = defaultdict(list)
    for n in live:
        for c in program.nodes[n].reads:
            readers[c].append(n)
    kept = set(program.outputs.values())

    def loop_of(g: int) -> int | None:
        """Return the level of the only loop that reads a group, lane by lane; None if there is no such loop."""
        levels = set[int]()
        for lane, n in program.groups[g].nodes.items():
            if n in kept or not readers[n]:
                return None
            for m in readers[n]:
                reader = program.group_of.get(m)
                if reader is None or program.lane_of[m] != lane:
                    return None
                if program.groups[reader].lanes != program.groups[g].lanes:
                    return None
                levels.add(program.level["group", reader])
        return levels.pop() if len(levels) == 1 else None

    for g in sorted(range(len(program.groups)), key=lambda g: -min(program.groups[g].nodes.values())):
        level = loop_of(g)
        if level is None or level <= program.level["group", g]:
            continue
        operands = {
            program.group_of[c]
            for n in program.groups[g].nodes.values()
            for c in program.nodes[n].reads
            if c in program.group_of
        }
        nodes = set(program.groups[g].nodes.values())
        exclusive = [o for o in operands if all(set(readers[n]) <= nodes for n in program.groups[o].nodes.values())]
        newly_stored = [o for o in operands if o not in exclusive and not _outside(program, readers, kept, o)]
        if not newly_stored:
            program.level["group", g] = level


def _read(program: Lanes) -> tuple[dict[int, Key], list[int | None]]:
    """Fill nodes and outputs. Returns keys that say how constants of a part are computed, and the lane of each node."""
    f, body = program.body.function, program.body
    numbers = body.arguments + len(body.sizes)
    written: dict[int, int] = {}
    keys: dict[int, Key] = {}
    lane: list[int | None] = []
    for k in range(f.n_instructions()):
        op, inputs, outputs = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_OUTPUT:
            program.outputs[outputs[0], outputs[1]] = written[inputs[0]]
            continue
        n = len(program.nodes)
        node_lane: int | None = None
        if op == ca.OP_CONST:
            node = Node(op, value=float(f.instruction_constant(k)))
        elif op == ca.OP_INPUT and inputs[0] == numbers:
            name, node_lane = body.lanes[inputs[1]]
            node, keys[n] = Node(op, value=body.values[inputs[1]]), (name,)
        elif op == ca.OP_INPUT:
            node = Node(op, place=(inputs[0], inputs[1]))
        else:
            reads = tuple(written[i] for i in inputs)
            values = [program.nodes[i].value for i in reads]
            lanes = {lane[i] for i in reads} - {None}
            node_lane = lanes.pop() if len(lanes) == 1 else None
            value = _NUMBERS[op](*values) if op in _NUMBERS and None not in values else None
            node = Node(op, reads, value=value)
            if value is not None and node_lane is not None:
                keys[n] = (op, *[keys.get(i, (program.nodes[i].value,)) for i in reads])
        program.nodes.append(node)
        lane.append(node_lane)
        written[outputs[0]] = n
    return keys, lane


def _live(program: Lanes) -> set[int]:
    live, pending = set[int](), list(program.outputs.values())
    while pending:
        n = pending.pop()
        if n not in live and not program.is_number(n):
            live.add(n)
            pending += program.nodes[n].reads
    return live


def _depths(program: Lanes, live: set[int]) -> dict[int, Depth]:
    """Return for each node how many systems are solved before it, and its longest path from inputs."""
    depth: dict[int, Depth] = {}
    for n in sorted(live):
        node = program.nodes[n]
        reads = [depth[c] for c in node.reads if not program.is_number(c)]
        solution = node.place[0] - program.body.arguments + 1 if node.op == ca.OP_INPUT else 0
        depth[n] = max([max(0, solution), *[s for s, _ in reads]]), 1 + max((d for _, d in reads), default=0)
    return depth


def _group(program: Lanes, keys: dict[int, Key], lane: list[int | None], depth: dict[int, Depth]) -> None:
    """Group nodes of different lanes with equal operations: first those with the same operands outside their lane, then
    those with operands of the same kind."""
    by_depth: dict[Depth, list[int]] = defaultdict(list)
    for n in sorted(depth):
        if lane[n] is not None and program.nodes[n].reads:
            by_depth[depth[n]].append(n)

    def key(n: int, loosely: bool) -> Key:
        parts: list[object] = [program.nodes[n].op]
        for c in program.nodes[n].reads:
            if c in keys:
                parts.append(keys[c])
            elif program.is_number(c):
                parts.append(("number", program.nodes[c].value))
            elif c in program.group_of:
                parts.append(("group", program.group_of[c]))
            else:
                parts.append(("any",) if loosely else ("node", c))
        return tuple(parts)

    for _, nodes in sorted(by_depth.items()):
        alike: dict[Key, dict[int, list[int]]] = defaultdict(lambda: defaultdict(list))
        for n in nodes:
            alike[key(n, False)][lane[n] or 0].append(n)
        rows_by_kind: dict[Key, list[dict[int, int]]] = defaultdict(list)
        for of_lane in alike.values():
            for k in range(max(map(len, of_lane.values()))):
                row = {x: members[k] for x, members in of_lane.items() if k < len(members)}
                rows_by_kind[key(next(iter(row.values())), True)].append(row)
        for rows in rows_by_kind.values():
            merged: list[dict[int, int]] = []
            for row in sorted(rows, key=lambda r: (-len(r), min(r.values()))):
                partner = next((m for m in merged if not m.keys() & row.keys()), None)
                if partner is None:
                    merged.append(dict(row))
                else:
                    partner |= row
            for row in merged:
                lanes = sorted(row)
                if len(lanes) >= FEWEST and lanes == list(range(lanes[0], lanes[-1] + 1)):
                    for x in lanes:
                        program.group_of[row[x]], program.lane_of[row[x]] = len(program.groups), x
                    program.groups.append(Group({x: row[x] for x in lanes}))


def _chain(program: Lanes, live: set[int]) -> None:
    """Find sums that take the same groups of one lane after the other."""
    users: dict[int, list[int]] = defaultdict(list)
    for n in sorted(live):
        for c in program.nodes[n].reads:
            users[c].append(n)
    kept = set(program.outputs.values())

    def term(n: int) -> tuple[int, int] | None:
        """Return operation and node, if a node adds or subtracts a node of a group; else None."""
        node = program.nodes[n]
        if n in program.group_of or node.op not in _CHAINED or node.reads[1] not in program.group_of:
            return None
        return node.op, node.reads[1]

    for n in sorted(live):
        if n in program.chain_of or term(n) is None:
            continue
        run = [n]
        while run[-1] not in kept and len(users[run[-1]]) == 1:
            after = users[run[-1]][0]
            if term(after) is None or program.nodes[after].reads[0] != run[-1] or after in program.chain_of:
                break
            run.append(after)
        terms = [t for t in map(term, run) if t is not None]
        of_lane = [program.lane_of[m] for _, m in terms]
        period = next((k for k, x in enumerate(of_lane) if x != of_lane[0]), len(terms))
        times = len(run) // period
        kinds = [(op, program.group_of[m]) for op, m in terms]
        lanes = tuple(range(of_lane[0], of_lane[0] + times))
        if (
            times >= FEWEST and len(run) == times * period and kinds == kinds[:period] * times
            and of_lane == [x for x in lanes for _ in range(period)]
        ):  # fmt: skip
            for m in run:
                program.chain_of[m] = len(program.chains)
            program.chains.append(LaneSum(program.nodes[n].reads[0], lanes, run, kinds[:period]))


def lines_of(program: Lanes) -> int:
    """Return the number of lines of C; all lanes of a group share one."""
    singles = sum(kind == "node" and program.nodes[n].op != ca.OP_INPUT for kind, n in program.level)
    return singles + len(program.groups) + sum(len(c.terms) for c in program.chains)


def _outside(program: Lanes, readers: dict[int, list[int]], kept: set[int], g: int) -> bool:
    """True if a group is stored in any case, because another loop or a single statement reads it."""
    level, lanes = program.level["group", g], program.groups[g].lanes
    for lane, n in program.groups[g].nodes.items():
        if n in kept:
            return True
        for m in readers[n]:
            reader_group = program.group_of.get(m)
            if reader_group is None or program.lane_of[m] != lane:
                return True
            if program.level["group", reader_group] != level or program.groups[reader_group].lanes != lanes:
                return True
    return False
