"""Kind "trajectory_table": Dressler 2012, Table 3.1, by its findings; the printed numbers have other poses."""

from __future__ import annotations

from functools import cache

import pytest

from gtmodel import SolveStatus
from gtmodel.motion import MotionTable
from gtmodel.problem_files import InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import context_of, explain, solve
from gtmodel.results.quantity import described

# optima of the reference instance on 50 x 3 points, as another code found them
FREE = {0: (0.892486, 0.892387), 1: (0.978454,), 2: (1.509980, 1.511666)}
LINE = 1.041242
MOST_ITERATIONS = (100, 100, 45, 20)  # from the trapezoid along the line, at 1e-8
PRINTED = 1e-5


@cache
def outcome():
    loaded = load("problems/table_3_1.toml")
    return solve(loaded, context_of(loaded)).outcome


def refused(*settings: str) -> InputError:
    loaded = load("problems/table_3_1.toml", settings)
    with pytest.raises(InputError) as caught:
        solve(loaded, context_of(loaded))
    return caught.value


class TestTable:
    def test_costs_and_iterations(self):
        o = outcome()
        assert o.status is SolveStatus.SOLVED and o.message.startswith("4 rows solved and re-simulated")
        assert set(o.values) == set(described(MotionTable))
        rows = o.values["rows"]
        for n, costs in FREE.items():
            assert min(abs(rows[n]["cost"] / c - 1) for c in costs) < PRINTED
        assert rows[3]["cost"] == pytest.approx(LINE, rel=PRINTED)
        assert all(row["iterations"] <= most for row, most in zip(rows, MOST_ITERATIONS, strict=True))
        assert all(check.passed for check in o.checks.values())
        assert {f"row_{n}_{name}" for n in (1, 2, 3, 4) for name in ("iterations", "exported_end_error_m")} <= set(
            o.checks
        )

    def test_both_optima_at_the_largest_weight(self):
        assert outcome().values["rows"][2]["optima"] == pytest.approx(FREE[2], rel=PRINTED)

    def test_findings_of_the_thesis(self):
        """Section 3.5: the free path is some per cent faster at about twice the energy; energy falls with its weight;
        without it all motors are at their limit most of the time, on the line only motor 3."""
        values, rows = outcome().values, outcome().values["rows"]
        assert 0.05 < values["saving"] < 0.15
        assert 1.7 < values["energy_ratio"] < 2.3
        assert rows[0]["energy"] > rows[1]["energy"] > rows[2]["energy"]
        assert rows[0]["final_time_s"] < rows[1]["final_time_s"] < rows[2]["final_time_s"] < rows[3]["final_time_s"]
        assert min(rows[0]["saturation"]) > 0.9
        assert rows[3]["saturation"][2] > 0.95 and max(rows[3]["saturation"][:2]) < 0.01

    def test_printed_beside_published(self):
        shown = {row.label: (row.value, row.unit) for row in outcome().rows}
        assert shown["free, w = 0: final time [s]"][1] == "published 0.9074"
        assert shown["line, w = 0: iterations"][1] == "published 70"
        assert shown["free, w = 0.01: optima"][0] == "1.509980 1.511666"
        assert shown["free, w = 0 saves"][0] == pytest.approx(14.3, abs=0.1)

    def test_files_and_pictures(self):
        o = outcome()
        assert {f"row_{n}_{name}" for n in (1, 2, 3, 4) for name in ("reference.csv", "motion.mod")} == set(o.files)
        forces, paths = o.figures["forces"](), o.figures["paths"]()
        assert len(forces.axes) == 3 and all(len(a.lines) == 4 + 2 for a in forces.axes)
        assert [a.get_ylabel() for a in forces.axes] == [f"motor {k} [N]" for k in (1, 2, 3)]
        assert paths.axes[0].get_zlabel() == "z [m]" and len(paths.axes[0].lines) == 4


class TestSentences:
    def test_a_wrong_row(self):
        error = refused('row.1.set={"cost.power"=1.0}')
        assert error.key == "row[1].set" and "cost.power" in error.sentence
        error = refused('row.2.set={"limits.force_N"=20.0}')
        assert error.key.startswith("limits.force_N") or "row[2]" in str(error)
        assert "20 N is not enough" in str(error)

    def test_explain(self):
        loaded = load("problems/table_3_1.toml")
        text = explain(loaded, context_of(loaded))
        assert text.count("Radau points") == 4 and "along: line of 0.9657 m" in text

    def test_stop(self):
        loaded = load("problems/table_3_1.toml")
        context = context_of(loaded)
        context.request_stop()
        o = solve(loaded, context).outcome
        assert o.status is SolveStatus.INTERRUPTED and o.message.startswith("row 1, free, w = 0: ")
