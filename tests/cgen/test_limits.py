"""Issue 8, point 3: instructions of a call with parameters as inputs, folded, and of the guards round it."""

from __future__ import annotations

from itertools import accumulate
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from gtmodel._files import codegen_dir
from gtmodel.cgen.body import trimmed
from gtmodel.compiler.causal import CausalFunction
from gtmodel.compiler.evaluate import build
from gtmodel.compiler.plan import make_plan
from tests.bench.callgrind import Call, body_call, count, generate, guarded_call
from tests.bench.three_link_pairs import Pair, three_link_pairs

# most instructions of a body with parameters as inputs, at -O2
LIMITS = {"fk": 260, "ik": 250, "velocity": 220, "inverse_dynamics_linear": 850, "inverse_dynamics_tanh": 850 + 400}
# measured, with the directions of the guideways as inputs too, which the peer does not know: 188, 152, 213, 771, 1158
LEAST = 207  # velocity map by hand, directions as inputs
FOLDED = 420  # inverse dynamics, massless links
# most that the guards add, with the size of every input: measured 96 for the nine of inverse dynamics with gcc 12.2
GUARDS = {key: 100 if key.startswith("inverse_dynamics") else 80 for key in LIMITS}


@pytest.fixture(scope="module")
def pairs(callgrind: None) -> list[Pair]:
    return [p for p in three_link_pairs().all if p.key in LIMITS]


def parametric(p: Pair, folded: bool = True) -> ca.Function:
    """(inputs, parameters) -> (targets, margins); of these only the direction of the guideways is folded, as in the
    peer, or none."""
    f = p.function
    names = [q.name for q in f.flat.parameters]
    entries = ca.vertsplit(f.flat.p)
    fold = ca.vertcat(
        *[
            ca.SX(q.value) if folded and (n == "v" or n.startswith("v[")) else e
            for n, e, q in zip(names, entries, f.flat.parameters, strict=True)
        ]
    )
    known = [i for _, _, indices in f.groups for i in indices]
    pairs = [pair for s in f.outputs for pair in s.pairs]
    plan = make_plan(f.flat, known, pairs, f.preferred, f.branches, fold=fold)
    unfolded = CausalFunction(plan, f.inputs, f.outputs, p.key)
    return build(plan, *unfolded._signals(), f"parametric_{p.key}", parametric=True).closed


def sources(functions: list[ca.Function], folder: Path) -> Path:
    generator = ca.CodeGenerator("parametric.c", {"with_header": True, "prefix": "parametric"})
    for f in functions:
        generator.add(f)
    source = Path(generator.generate(f"{folder}/"))
    source.write_text(trimmed(source.read_text(), "parametric", {f.name() for f in functions}))
    (folder / "gt_float.h").write_text((codegen_dir() / "runtime" / "gt_float.h").read_text())
    return source


def parametric_call(p: Pair, f: ca.Function) -> Call:
    values = np.array([q.value for q in p.function.flat.parameters])
    points = np.hstack([p.peer.points, np.tile(values, (len(p.peer.points), 1))])
    inputs, outputs = ([*accumulate([g(k) for k in range(n)], initial=0)]
                       for g, n in ((f.numel_in, f.n_in()), (f.numel_out, f.n_out())))  # fmt: skip
    arg = ", ".join(f"in + {k}" for k in inputs[:-1])
    res = ", ".join(f"out + {k}" for k in outputs[:-1])
    statement = (
        f"{{ const double *arg[] = {{{arg}}}; double *res[] = {{{res}}}; long long int iw[1]; double w[1]; "
        f"{f.name()}(arg, res, iw, w, 0); }}"
    )
    return Call(f.name(), statement, points, outputs[-1], "parametric.h")


@pytest.mark.parametrize("folded", [True, False])
def test_parameters_as_inputs(folded: bool, pairs: list[Pair], tmp_path: Path) -> None:
    functions = {p.key: parametric(p, folded) for p in pairs}
    calls = {p.key: parametric_call(p, functions[p.key]) for p in pairs}
    found = count(calls, [sources(list(functions.values()), tmp_path)])
    for p in pairs:
        np.testing.assert_allclose(found[p.key].outputs[:, :3], p.expected, rtol=1e-9, atol=1e-9)
    costs = {key: round(c.instructions) for key, c in found.items()}
    assert {key: cost for key, cost in costs.items() if cost > LIMITS[key]} == {}


def test_general_velocity_map_by_hand(pairs: list[Pair], tmp_path: Path) -> None:
    """Each number once, one root and two divisions per arm: what a compiler of these equations can aim at."""
    (p,) = [p for p in pairs if p.key == "velocity"]
    names = [q.name for q in p.function.flat.parameters]
    T, Td, parameters = ca.SX.sym("T", 3), ca.SX.sym("Td", 3), ca.SX.sym("p", len(names))

    def entries(*wanted: str) -> ca.SX:
        return ca.vertcat(*[parameters[names.index(name)] for name in wanted])

    rates, margins = [], []
    for k in range(3):
        A, v = (entries(*[f"{name}[{k},{i}]" for i in range(3)]) for name in "Av")
        d = T - A
        half, square = ca.dot(d, v), ca.dot(v, v)
        discriminant = half * half - square * (ca.dot(d, d) - entries(f"L[{k}]") ** 2)
        root = ca.sqrt(discriminant)
        r = d - (half - root) / square * v
        rates.append(ca.dot(r, Td) / root)
        margins += [discriminant, root]
    by_hand = ca.Function(
        "by_hand", [T, Td, parameters], ca.cse([ca.SX(ca.vertcat(*rates)), ca.SX(ca.vertcat(*margins))])
    )
    found = count({"it": parametric_call(p, by_hand)}, [sources([by_hand], tmp_path)])["it"]
    np.testing.assert_allclose(found.outputs[:, :3], p.expected, rtol=1e-9, atol=1e-9)
    assert found.instructions <= LEAST


def test_folded_and_guarded(pairs: list[Pair], tmp_path: Path) -> None:
    files = generate({p.key: p.function for p in pairs}, tmp_path / "generated")
    calls = {f"body {p.key}": body_call(p.key, p.function, p.peer.points) for p in pairs}
    calls |= {f"guarded {p.key}": guarded_call(p.key, p.function, p.peer.points) for p in pairs}
    costs = {key: c.instructions for key, c in count(calls, files).items()}
    assert costs["body inverse_dynamics_linear"] <= FOLDED
    added = {p.key: costs[f"guarded {p.key}"] - costs[f"body {p.key}"] for p in pairs}
    assert {key: cost for key, cost in added.items() if cost > GUARDS[key]} == {}
