"""Several motions in one table: Dressler 2012, Table 3.1, by its findings; the printed numbers have other poses."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from gtmodel import SolveStatus
from gtmodel.motion import Line, MotionTable, Published, Starts, TableRow, table_study
from gtmodel.results import ArgumentError
from gtmodel.results.quantity import described
from tests.support.motions import asked

# optima of the reference instance on 50 x 3 points, as another code found them
FREE = {0: (0.892486, 0.892387), 1: (0.978454,), 2: (1.509980, 1.511666)}
LINE = 1.041242
MOST_ITERATIONS = (100, 100, 45, 20)  # from the trapezoid along the line, at 1e-8
PRINTED = 1e-5


PRINTED_ROWS = (Published(0.9074, 103.8448, 199), Published(0.9191, 77.0024, 53), Published(0.9968, 50.1301, 26),
                Published(0.97612, 57.32659, 70))  # fmt: skip


def rows(**changes) -> list[TableRow]:
    """Those of problems/table_3_1.toml."""
    problems = {
        "free, w = 0": asked(**changes),
        "free, w = 0.001": asked(cost__energy=0.001, **changes),
        "free, w = 0.01": asked(cost__energy=0.01, starts=Starts(count=2, bend=0.4), **changes),
        "line, w = 0": asked(path=Line(), **changes),
    }
    return [
        TableRow(name, problem, most, printed)
        for (name, problem), most, printed in zip(problems.items(), MOST_ITERATIONS, PRINTED_ROWS, strict=True)
    ]


@cache
def outcome() -> MotionTable:
    return table_study(rows())


class TestTable:
    def test_costs_and_iterations(self):
        o = outcome()
        assert o.status is SolveStatus.SOLVED and o.message.startswith("4 rows: solved and re-simulated")
        assert set(o.values) == set(described(MotionTable))
        rows = o.entries
        for n, costs in FREE.items():
            assert min(abs(rows[n]["cost"] / c - 1) for c in costs) < PRINTED
        assert rows[3]["cost"] == pytest.approx(LINE, rel=PRINTED)
        assert all(row["iterations"] <= most for row, most in zip(rows, MOST_ITERATIONS, strict=True))
        assert all(check.passed for check in o.checks.values())
        assert {f"row_{n}_{name}" for n in (1, 2, 3, 4) for name in ("iterations", "exported_end_error_m")} <= set(
            o.checks
        )

    def test_both_optima_at_the_largest_weight(self):
        assert outcome().entries[2]["optima"] == pytest.approx(FREE[2], rel=PRINTED)

    def test_findings_of_the_thesis(self):
        """Section 3.5: the free path is some per cent faster at about twice the energy; energy falls with its weight;
        without it all motors are at their limit most of the time, on the line only motor 3."""
        o, rows = outcome(), outcome().entries
        assert 0.05 < o.saving < 0.15
        assert 1.7 < o.energy_ratio < 2.3
        assert rows[0]["energy"] > rows[1]["energy"] > rows[2]["energy"]
        assert rows[0]["final_time_s"] < rows[1]["final_time_s"] < rows[2]["final_time_s"] < rows[3]["final_time_s"]
        assert min(rows[0]["saturation"]) > 0.9
        assert rows[3]["saturation"][2] > 0.95 and max(rows[3]["saturation"][:2]) < 0.01

    def test_printed_beside_published(self):
        shown = {row.label: (row.value, row.unit) for row in outcome().rows}
        assert shown["free, w = 0: final time [s]"][1] == "published 0.9074"
        assert shown["line, w = 0: iterations"][1] == "published 70"
        assert shown["free, w = 0.01: optima"][0] == "1.509980 1.511666"
        assert shown["time saving of free, w = 0"][0] == pytest.approx(14.3, abs=0.1)

    def test_files_and_pictures(self):
        o = outcome()
        assert {f"row_{n}_{name}" for n in (1, 2, 3, 4) for name in ("reference.csv", "motion.mod")} == set(o.files)
        forces, paths = o.figure("forces"), o.figure("paths")
        assert len(forces.axes) == 3 and all(len(a.lines) == 4 + 2 for a in forces.axes)
        assert [a.get_ylabel() for a in forces.axes] == [f"force of motor {k} [N]" for k in (1, 2, 3)]
        drawn = [line.get_label() for line in paths.axes[0].lines]
        assert paths.axes[0].get_zlabel() == "z [m]" and len(drawn) == 6, drawn


class TestRefusals:
    def test_a_wrong_row(self):
        wrong = rows()
        wrong[2] = replace(wrong[2], problem=asked(limits__force=20.0))
        with pytest.raises(ArgumentError) as caught:
            table_study(wrong)
        assert caught.value.argument == "rows[2].problem.limits.force"

    def test_one_row_is_no_table(self):
        with pytest.raises(ArgumentError) as caught:
            table_study(rows()[:1])
        assert caught.value.argument == "rows"

    def test_stop(self):
        o = table_study(rows(), stop=lambda: True)
        assert o.status is SolveStatus.INTERRUPTED and o.message.startswith("row 1, free, w = 0: ")
        assert len(o.motions) == 1 and o.saving is None and o.rows == []
