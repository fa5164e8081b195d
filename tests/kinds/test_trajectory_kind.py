"""Kinds "trajectory" and "trajectory_table": keys of the files, where refusals stand in them, what is shown."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gtmodel.compiler.flat_cache import shared
from gtmodel.problem_files import InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, context_of, explain, keyed, solve
from gtmodel.results import SolveStatus
from tests.support.motions import asked, changed, solution

L1, TABLE = "problems/l1_min_time.toml", "problems/table_3_1.toml"
LIGHT = ["cost.energy=1.0", "mesh.elements=6"]


def refused(*settings: str, file: str = L1, folder=None) -> InputError:
    """What is refused before anything is optimised."""
    with pytest.raises(InputError) as caught:
        loaded = load(file, settings)
        context = context_of(loaded)
        context.folder = folder or context.folder
        with keyed(loaded):
            explain(loaded, context)
    return caught.value


@pytest.mark.parametrize(
    "changes",
    [{"cost__energy": 0.01, "mesh__elements": 15}],
)
def test_the_file_and_the_call_give_equal_values(changes):
    found = answer(load(L1, ["cost.energy=0.01", "mesh.elements=15"]), context_of(load(L1)))
    assert found.values == solution(**changes).values and found.files == solution(**changes).files


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("limits.force_N=0", "limits.force_N"),
        ("cost.time=-1.0", "cost.time"),
        ("mesh.elements=0", "mesh.elements"),
        ("mesh.points=10", "mesh.points"),
        ('goal.rest=["position"]', "goal.rest[0]"),
        ("goal.tcp_m=[0.0,1.0]", "goal.tcp_m"),
        ('mesh.control="linear"', "mesh.control"),
        ("payload_kg=-1.0", "payload_kg"),
        ("limits.tcp_velocity_m_s=0.0", "limits.tcp_velocity_m_s"),
        ("limits.cart_low_m=[0.0]", "limits.cart_low_m"),
        ("limits.speed=1.0", "limits.speed"),
        ("limits.obstacles=[{center_m=[0.0,0.0,0.0], size_m=[0.1,0.1,-0.1]}]", "limits.obstacles[0].size_m[2]"),
        ("limits.joint_cones=[{arm=0, end='top', axis=[1.0,0.0,0.0], half_angle_deg=4.0}]",
         "limits.joint_cones[0].end"),
        ("export.sample_s=0.0", "export.sample_s"),
        ('path.shape="circle"', "path.shape"),
    ],
)  # fmt: skip
def test_wrong_values_name_their_key(setting, key):
    with pytest.raises(InputError) as caught:
        load(L1, [setting])
    assert caught.value.key == key


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (["goal.tcp_m=[0.9,-3.0,0.45]"], "goal.tcp_m"),
        (["start.tcp_m=[0.9,-3.0,0.45]"], "start.tcp_m"),
        (["cost.time=0.0"], "cost"),
        (["limits.force_N=20"], "limits.force_N"),
        (["limits.tcp_low_m=[0.0,0.0,0.0]", "limits.tcp_high_m=[1.0,-1.0,1.0]"], "limits.tcp_low_m"),
        (["limits.tcp_high_m=[0.5,0.0,1.0]"], "goal.tcp_m"),
        (["limits.joint_cones=[{arm=3, end='cart', axis=[1.0,0.0,0.0], half_angle_deg=45.0}]"],
         "limits.joint_cones[0].arm"),
        (['path.shape="line"', "limits.obstacles=[{center_m=[0.45,-0.9,0.275], size_m=[0.1,0.1,0.1]}]"], "path"),
        (['path.shape="arc"'], "path.through_m"),
        (['path.shape="arc"', "path.through_m=[0.45,-0.9,0.275]"], "path.through_m"),
        (['path.shape="line"', "path.through_m=[0.4,-0.9,0.3]"], "path.through_m"),
        (['path.shape="polyline"', "path.via_m=[[0.01,-0.9,0.1]]"], "path.blend_m"),
        (['path.shape="spline"'], "path.file"),
        (['path.shape="spline"', 'path.file="nowhere.csv"'], "path.file"),
    ],
)  # fmt: skip
def test_refusals_stand_at_their_key(settings, key):
    assert refused(*settings).key == key


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("x_m,y_m\n0,1\n", "path.file"),
        ("x_m,y_m,z_m\n0,1,0\n0,1,2\n", "path.file"),
        ("x_m,y_m,z_m\n0,1,0\n0,1,0\n0,1,2\n", "path.file"),
        ("x_m,y_m,z_m\n0.1,-0.9,0.1\n0.5,-0.9,0.4\n0.9,-0.9,0.45\n", "start.tcp_m"),
    ],
)
def test_a_file_of_points_is_refused_at_its_key(tmp_path, text, key):
    (tmp_path / "points.csv").write_text(text)
    assert refused('path.shape="spline"', 'path.file="points.csv"', folder=tmp_path).key == key


def test_a_file_of_points_is_taken(tmp_path):
    (tmp_path / "points.csv").write_text("x_m,y_m,z_m\n0,-0.9,0.1\n0.5,-0.9,0.4\n0.9,-0.9,0.45\n")
    loaded = load(L1, ['path.shape="spline"', 'path.file="points.csv"'])
    context = context_of(loaded)
    context.folder = tmp_path
    call = loaded.kind.call(loaded.problem, context)
    assert call.options["path"].points.shape == (3, 3) and context.inputs["path"] == tmp_path / "points.csv"


def test_from_an_earlier_result(tmp_path):
    loaded = load(L1, LIGHT)
    first = solve(loaded, context_of(loaded), out=tmp_path / "a").outcome
    again = answer(loaded, context_of(loaded, start=tmp_path / "a"))
    assert again.status is SolveStatus.SOLVED
    assert again.objective == pytest.approx(first.objective, rel=1e-6)
    context = context_of(loaded)
    context.start = {"trajectory": {"time_s": [0.0, 0.5, 1.0], "values": {"x": [1.0] * 3}, "units": {}}}
    with pytest.raises(InputError) as caught:
        answer(loaded, context)
    assert caught.value.key == "--start"


def test_the_same_file_gives_the_same_bytes(tmp_path):
    loaded = load(L1, LIGHT)
    results = []
    for name in ("a", "b"):
        shared.cache_clear()  # compiled anew
        solve(loaded, context_of(loaded), out=tmp_path / name)
        results.append((tmp_path / name / "result.json").read_bytes())
    assert results[0] == results[1] and json.loads(results[0])["values"]["final_time_s"] > 1


def test_explain():
    loaded = load(L1)
    text = explain(loaded, context_of(loaded))
    first, *rest = text.splitlines()
    assert first == "Time-optimal motion of the L1 prototype: inverse form, 50 elements x 3 Radau points"
    assert rest[0] == "  states: " + ", ".join(
        f"{n}robot.T[{i}]{')' if n else ''}" for i in range(3) for n in ("", "der(")
    )
    assert rest[1] == "  controls: robot.tau[0], robot.tau[1], robot.tau[2] within 700 N"
    assert rest[2] == "  free: final_time"
    assert "robots/three_link.py:" in text and "tau" in text


class TestTable:
    def test_rows_are_those_of_the_file(self):
        loaded = load(TABLE)
        call = loaded.kind.call(loaded.problem, context_of(loaded))
        (rows,) = call.arguments
        assert [row.problem.cost.energy for row in rows] == [0.0, 0.001, 0.01, 0.0]
        assert [row.published.iterations for row in rows] == [199, 53, 26, 70]
        assert rows[2].problem.starts.bend == 0.4 and rows[3].problem.path.intervals == 400
        expected = changed(asked(), title="free, w = 0")
        assert rows[0].problem.limits == expected.limits and rows[0].problem.title == expected.title
        assert np.array_equal(rows[0].problem.robot.L, expected.robot.L)

    def test_a_wrong_row(self):
        error = refused('row.1.set={"cost.power"=1.0}', file=TABLE)
        assert error.key == "row[1].set" and "cost.power" in error.message
        loaded = load(TABLE, ['row.2.set={"limits.force_N"=20.0}'])
        with pytest.raises(InputError) as caught:
            answer(loaded, context_of(loaded))
        assert caught.value.key == "limits.force_N" and "20 N is too small" in caught.value.message

    def test_explain(self):
        loaded = load(TABLE)
        text = explain(loaded, context_of(loaded))
        assert text.count("Radau points") == 4 and "along: line of 0.9657 m" in text


def test_a_list_that_is_too_short_says_how_many_entries_are_expected():
    with pytest.raises(InputError) as caught:
        load("problems/table_3_1.toml", ["row=[]"])
    assert (caught.value.key, caught.value.message) == ("row", "expected at least 2 entries; found []")


def test_the_shipped_table_bounds_no_iterations() -> None:
    """They belong to one instance: with another limit of the force all rows are solved, with more of them."""
    assert [row.most_iterations for row in load(TABLE, ["limits.force_N=900.0"]).problem.row] == [None] * 4


def test_a_path_that_is_not_there_says_where_to_get_it() -> None:
    asked = ['path.shape="spline"', 'path.file="nowhere.csv"', 'path.source="the drawing office"']
    assert refused(*asked).message.endswith("; get it from the drawing office and put it there")
    assert refused('path.shape="line"', 'path.source="nobody"').key == "path.source"
