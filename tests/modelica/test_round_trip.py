"""Random models as text: their residuals, also after printing, agree with plain Python."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings

import gtmodel as gt
from gtmodel.compiler.causal import flat_of
from gtmodel.modelica.classes import identifier
from tests.modelica.drawn import Drawn, models

pytest.importorskip("lark")
CLOSE = 1e-13  # of the largest number that occurs; sums of some tens of terms in double
POINTS = 3


def residuals(model: Any, values: list[dict[str, float]], naming: Any) -> np.ndarray:
    """(points, equations) at values of variables and derivatives by name, parameters at their own."""
    flat = flat_of(model)
    column = ca.vertcat(*[e.residual for e in flat.equations])
    own = {q.symbol.name(): q.value for q in flat.parameters}
    symbols = ca.symvar(column)
    here = [{naming(n): x for n, x in v.items()} | own for v in values]
    drawn = np.array([[v[x.name()] for v in here] for x in symbols])
    return np.array(ca.Function("f", [ca.vertcat(*symbols)], [column])(drawn)).T


def python_name(name: str) -> str:
    return f"der({identifier(name[4:-1])})" if name.startswith("der(") else identifier(name)


def misread(drawn: Drawn, folder: Path) -> list[str]:
    """Forms of a drawn model whose residuals are not those of plain Python: its text, flat and printed as Python."""
    names = list(dict.fromkeys(drawn.residuals(defaultdict(float))[1]))
    random = np.random.default_rng(5)
    values = [dict(zip(names, random.uniform(-2, 2, len(names)), strict=True)) for _ in range(POINTS)]
    by_hand = [drawn.residuals(v) for v in values]
    file, flat = folder / "drawn.mop", folder / "flat.mop"
    file.write_text(drawn.source())
    flat.write_text(gt.modelica.flat_of_text(f"{file}:M"))
    world: dict[str, Any] = {"__name__": "printed"}
    exec(gt.modelica.python_of(f"{file}:M"), world)
    forms = {
        "text": (gt.modelica.load(f"{file}:M"), str), "flat": (gt.modelica.load(flat), str),
        "Python": (world["M"], python_name),
    }  # fmt: skip
    expected = np.array([r for r, _, _ in by_hand])
    wrong = [] if gt.modelica.flat_of_text(flat) == flat.read_text() else ["flat again"]
    scale = np.array([largest for _, _, largest in by_hand])[:, None]
    for form, (cls, naming) in forms.items():
        read = residuals(cls(), values, naming)
        # equations in any order: by their values at the first point
        a, b = np.argsort(read[0]), np.argsort(expected[0])
        if read.shape != expected.shape or not np.all(np.abs(read[:, a] - expected[:, b]) <= CLOSE * scale):
            wrong.append(form)
    return wrong


@settings(
    max_examples=12, derandomize=True, phases=[Phase.generate], deadline=None, suppress_health_check=list(HealthCheck)
)
@given(models())
def test_residuals_of_a_random_model(tmp_path_factory: pytest.TempPathFactory, drawn: Drawn) -> None:
    assert misread(drawn, tmp_path_factory.mktemp("drawn")) == [], drawn.source()


@pytest.mark.proof
@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(models())
def test_residuals_of_many_random_models(tmp_path_factory: pytest.TempPathFactory, drawn: Drawn) -> None:
    assert misread(drawn, tmp_path_factory.mktemp("drawn")) == [], drawn.source()


@pytest.mark.parametrize(("relation", "value"), [("<", 2.0), ("<=", 1.0), (">", 2.0), (">=", 1.0)])
def test_a_strict_relation_of_equal_sides_is_false(tmp_path: Path, relation: str, value: float) -> None:
    file = tmp_path / "equal.mop"
    file.write_text(
        "optimization M(objective = y(finalTime)) Real x(start = 1, fixed = true); Real y; equation der(x) = -1; "
        f"y = if x {relation} 1 then x else 2*x; end M;"
    )
    (rows,) = residuals(gt.modelica.load(file)(), [{"x": 1.0, "der(x)": -1.0, "y": 0.0}], str)
    assert sorted(rows) == [-value, 0.0]
