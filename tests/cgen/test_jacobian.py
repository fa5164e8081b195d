"""Jacobians of causal functions as functions of their own: against rows in NumPy, differences, and C."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.cgen.newton_stages import samples_of
from gtmodel.compiler.causal import CausalFunction, c_name
from gtmodel.kinds.codegen.kind import functions_of, write
from gtmodel.problem_files import InputError
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.load import load

EXACT = 1e-12  # of the largest entry: two orders of the same derivatives
STEP = 1e-4
ORDER = 1.9  # of central differences, whose error falls with the square of the step
POINTS = 200


@pytest.fixture(scope="module")
def given() -> dict[str, CausalFunction]:
    l1 = gt.robots.gantry_tau("l1_tape")
    six = gt.robots.six_link_gantry_tau()
    return {
        "velocity": l1.causal(known="q", targets=["T", "der(T)"]), "forces": l1.causal(known="T", targets="tau"),
        "newton": six.causal("q", ["T", "e"]),
    }  # fmt: skip


def near_home(f: CausalFunction, rows: int) -> list[np.ndarray]:
    home = samples_of(f, [p for s in f.inputs for p in s.pairs])[0]
    values = home + 0.02 * np.random.default_rng(1).normal(size=(rows, len(home)))
    return np.split(values, np.cumsum([s.size for s in f.inputs])[:-1], axis=1)


def whole(f: CausalFunction, J: CausalFunction, values: Any) -> np.ndarray:
    """All blocks as one matrix (n, outputs, inputs); blocks that are zero by structure are no results."""
    blocks = {s.name: v for s, v in zip(J.outputs, values, strict=True)}
    names = [[f"{c_name(t.name)}_by_{c_name(i.name)}" for i in f.inputs] for t in f.outputs]
    n = len(values[0])
    return np.concatenate([
        np.concatenate([
            blocks.get(name, np.zeros((n, t.size, i.size))).reshape(n, t.size, i.size)
            for name, i in zip(row, f.inputs, strict=True)
        ], axis=2)
        for row, t in zip(names, f.outputs, strict=True)
    ], axis=1)  # fmt: skip


@pytest.mark.parametrize("key", ["velocity", "forces", "newton"])
def test_equals_the_jacobian_of_rows_and_central_differences(key: str, given: dict[str, CausalFunction]) -> None:
    f = given[key]
    J, x = cgen.jacobian_function(f), near_home(f, 4)
    *values, status = J(*x)
    expected, other = f.jacobian(*x)
    assert np.array_equal(status, other) and np.all(status == Status.OK)
    found = whole(f, J, values)
    size = np.abs(expected).max()
    assert np.abs(found - expected).max() <= EXACT * size

    def differences(h: float) -> np.ndarray:
        columns, all_ = [], np.hstack(x)
        for k in range(all_.shape[1]):
            sides = []
            for sign in (1, -1):
                moved = all_.copy()
                moved[:, k] += sign * h
                *y, _ = f(*np.split(moved, np.cumsum([s.size for s in f.inputs])[:-1], axis=1))
                sides.append(np.hstack([v.reshape(len(moved), -1) for v in y]))
            columns.append((sides[0] - sides[1]) / (2 * h))
        return np.stack(columns, axis=2)

    errors = [np.abs(differences(h) - found).max() for h in (10 * STEP, STEP)]
    assert errors[1] < 1e-5 * size
    assert np.log10(errors[0] / errors[1]) > ORDER or errors[1] < 1e-8 * size


def test_c_equals_python_bit_for_bit(given: dict[str, CausalFunction], tmp_path: Path) -> None:
    made = {name: cgen.jacobian_function(f) for name, f in given.items()}
    cgen.generate(made, tmp_path / "c", name="jac")
    report = cgen.check(tmp_path / "c", made, points=POINTS)
    assert report.passed, str(report)
    assert min(report.rows_ok.values()) > POINTS / 4


def test_statuses_are_those_of_the_function(given: dict[str, CausalFunction]) -> None:
    f = given["velocity"]
    rows = [near_home(f, 1)[0][0], [-0.7, 9.0, -0.6], [np.nan, -0.8, -0.6], [1e200, -0.8, -0.6]]
    x = [np.array(rows), np.zeros((4, 3))]
    codes = f(*x)[-1]
    *values, status = cgen.jacobian_function(f)(*x)
    assert status.tolist() == codes.tolist() and len(set(codes.tolist())) >= 3
    assert all(np.isnan(v[1:]).all() and np.isfinite(v[0]).all() for v in values)


class Spring(gt.Model):
    x = gt.variable(unit="m")
    k = gt.parameter(3.0, unit="N/m2")
    force = gt.variable(unit="N")
    angle = gt.variable(unit="rad")
    arm = gt.parameter(2.0, unit="m")
    length = gt.variable(unit="m")

    def equations(self) -> Any:
        yield self.force == self.k * self.x**2
        yield self.length == self.arm * gt.sin(self.angle)


def test_scalars_units_and_blocks_without_dependence() -> None:
    J = cgen.jacobian_function(Spring().causal(known=["x", "angle"], targets=["force", "length"]))
    assert [(s.name, s.shape, s.unit) for s in J.outputs] == [
        ("force_by_x", (), "N/m"), ("length_by_angle", (), "m/rad"),
    ]  # fmt: skip
    assert J(0.5, 0.0) == (3.0, 2.0, Status.OK)


SETTINGS = ["functions.0.jacobian=true", "check.points=50"]


def test_the_key_of_a_problem_file(tmp_path: Path) -> None:
    problem: Any = load("problems/l1_controller.toml", SETTINGS).problem
    made = functions_of(problem, Context())
    assert list(made)[:2] == ["fk", "fk_jacobian"] and problem.jacobians == ["fk_jacobian"]
    study = write(problem, Context(), tmp_path / "c", verify=True)
    assert study.status.ok, study.message
    header = (tmp_path / "c" / "gt_l1.h").read_text()
    assert "double T_by_q[9];" in header and "gt_l1_fk_jacobian(" in header


def test_a_name_that_a_jacobian_takes_is_refused() -> None:
    problem: Any = load("problems/l1_controller.toml", [*SETTINGS, "functions.1.name='fk_jacobian'"]).problem
    with pytest.raises(InputError) as caught:
        functions_of(problem, Context())
    assert caught.value.key == "functions[1].name"
