"""Kind "milling": the shipped problem, dynamics from three sources, places, and what is refused, with its key."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.kinds import milling
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.results import SolveStatus
from gtmodel.vibration import fit_oscillator_field, oscillator_text
from tests.milling.thesis import OSCILLATORS

# only the shipped problem does all; the others leave out what they do not ask for
BARE = ("printed_tests=false", "search.speeds_rpm=[]", "search.feed_directions=[]", "search.refine=0")


def read(*changes: str) -> milling.Schema:
    problem = load("problems/milling_pose.toml", list(changes)).problem
    assert isinstance(problem, milling.Schema)
    return problem


def bare(*changes: str, **update):
    problem = read(*BARE, *changes)
    search = problem.search.model_copy(update={"speed_range_rpm": None})
    return problem.model_copy(update={"lobes": None, "compensation": None, "search": search, **update})


@pytest.fixture(scope="module")
def shipped():
    return milling.solve(read(), Context())


def test_the_shipped_problem_answers_in_words(shipped) -> None:
    v = shipped.values
    assert shipped.status is SolveStatus.SOLVED and list(v) == list(milling.VALUES)
    assert all(check.passed for check in shipped.checks.values())
    assert v["guideline"][0].startswith("use the dynamic model: at 64.5 Hz its angle 51 deg")
    assert "6.28 Hz above the mode along y at 58.2 Hz" in v["guideline"][1]
    assert v["static_choice_deg"] == pytest.approx(110) and v["ratio"] > 3
    # the index of the refined angle is not above that of the grid, which holds the printed choice
    grid = v["combinations"][0]
    assert v["dynamic_index_mm"] <= grid["index_mm"] < v["static_choice_index_mm"]
    angle, rpm, index = v["free_speed"]
    assert 49 <= angle <= 110 and 1200 <= rpm <= 3600 and index < v["dynamic_index_mm"]
    assert len(v["combinations"]) == 10 and all(ok for *_, ok in v["refined"])
    assert v["spectral_radius"] < 1 and v["mode_coupling"].startswith("no sign")
    none, static, dynamic, slow = v["compensation_rms_mm"]
    assert dynamic < 1e-3 * none and static < slow < 0.2 * none
    assert (
        shipped.files["compensation.csv"].startswith("time_s,x_m,y_m,z_m,offset_x_m")
        and len(v["printed_mean_mm"]["+x"]) == 12
    )
    said = [row.value for row in shipped.rows if row.label == "printed tests"]
    assert any(s.startswith("test 9 is missed") for s in said) and any(s.startswith("test 10 is missed") for s in said)
    labels = [row.label for row in shipped.rows]
    assert sum(label.startswith("test ") for label in labels) == 12


def test_pictures(shipped) -> None:
    assert set(shipped.figures) == {"angle", "lobes", "compensation", "printed_tests"}
    for make in shipped.figures.values():
        make().canvas.draw()
    static, modes = shipped.figures["angle"]().axes
    assert "dynamic index (19), largest over time" in static.get_legend_handles_labels()[1]
    assert "tooth frequency" in modes.get_legend_handles_labels()[1]


def test_static_alone_and_the_unreachable_part() -> None:
    found = milling.solve(bare(oscillator=None), Context())
    low, high = found.values["reachable_deg"][0]
    assert -180 < low < found.values["static_angle_deg"] < high < 180
    assert found.values["guideline"] is None and found.objective is None
    found.figures["angle"]().canvas.draw()
    with pytest.raises(InputError, match=r"^lobes: needs dynamics"):
        milling.solve(bare(oscillator=None, lobes=read().lobes), Context())


def test_dynamics_from_joint_stiffness_are_refined_in_reach() -> None:
    modal = milling.Schema.model_fields["modal"].annotation.__args__[0]  # type: ignore[union-attr]
    problem = bare(oscillator=None, modal=modal(mass_kg=[170.0, 100.0, 280.0], damping_ratio=[0.09, 0.1, 0.09]))
    search = problem.search.model_copy(update={"static_choice_deg": None, "refine": 2, "step_deg": 5.0})
    found = milling.solve(problem.model_copy(update={"search": search}), Context())
    v = found.values
    low, high = v["reachable_deg"][0]
    assert low <= v["dynamic_angle_deg"] <= high and "not a measurement" in v["dynamics"]
    assert v["dynamic_index_mm"] <= v["combinations"][0]["index_mm"] and all(ok for *_, ok in v["refined"])
    assert v["static_choice_deg"] == v["static_angle_deg"]


def test_a_field_over_the_poses_says_that_it_is_synthetic(tmp_path) -> None:
    o = OSCILLATORS[np.array([3, 1, 0, 5, 4, 9])]
    angles = np.deg2rad([49.0, 52.0, 110.0, 45.0, 110.0, 53.0])
    x, y = np.array([[-0.01073] * 3 + [0.6159] * 2 + [-0.00025], [-2.40047] * 5 + [-2.11124]])
    poses = np.column_stack([x, y, np.full(6, 0.30341), angles])
    field, _ = fit_oscillator_field(
        poses, o.m, o.c, o.k, starts=1, calibrate=False, synthetic="a field through six printed poses"
    )
    (tmp_path / "field.toml").write_text(oscillator_text(field), encoding="utf-8")
    problem = bare(oscillator=None, oscillator_field="field.toml")
    search = problem.search.model_copy(update={"step_deg": 4.0, "refine": 1})
    context = Context(folder=tmp_path)
    found = milling.solve(problem.model_copy(update={"search": search}), context)
    v = found.values
    assert "synthetic: a field through six printed poses" in v["dynamics"]
    assert "synthetic dynamics" in found.figures["angle"]().axes[0].get_title()
    assert context.inputs == {"oscillator_field": tmp_path / "field.toml"}
    assert v["dynamic_index_mm"] <= v["combinations"][0]["index_mm"] and v["refined"][0][2]
    # nothing is answered where the field knows little more than the mean of its poses
    away = problem.model_copy(update={"place_m": [1.8, 1.0, 0.5]})
    with pytest.raises(InputError, match="tells nothing of a reachable angle") as error:
        milling.solve(away, context)
    assert error.value.key == "oscillator_field"
    compared = search.model_copy(update={"step_deg": 4.0, "refine": 0, "places_m": [[1.8, 1.0, 0.5]]})
    beside = milling.solve(problem.model_copy(update={"search": compared}), context).values["combinations"]
    assert "too far from the poses" in beside[1]["reason"] and "index_mm" in beside[0]
    wrong = problem.model_copy(update={"oscillator_field": "none.toml"})
    with pytest.raises(InputError, match=r"^oscillator_field: none.toml cannot be read as an oscillator field"):
        milling.solve(wrong, context)


def test_places_that_cannot_be_reached_say_why() -> None:
    places = [[0.6159, -2.40092, 0.30447], [9.0, 0.0, 0.0]]
    problem = bare()
    search = problem.search.model_copy(update={"places_m": places, "step_deg": 4.0})
    combinations = milling.solve(problem.model_copy(update={"search": search}), Context()).values["combinations"]
    assert [("index_mm" in c) for c in combinations] == [True, True, False]
    assert "it is out of reach" in combinations[2]["reason"]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("cutter.diameter_mm=25.4", r"cutter.diameter_mm: unknown key; did you mean 'diameter_m' \(m\)\?"),
        ("cut.radial_depth_m=0.03", r"^cut.radial_depth_m: the radial depth 0.03 m is more than the diameter 0.0254 m"),
        ("cut.feed_per_tooth_m=-0.0005", r"^cut: feed_per_tooth is -0.0005 m; expected more than 0; the direction of"),
        ("cut.speed_rpm=0.0", r"^cut.speed_rpm: the spindle speed is 0 rpm; expected more than 0"),
        ("search.speeds_rpm=[100.0, -1.0]", r"^search.speeds_rpm\[1\]: the spindle speed is -1 rpm"),
        ("cut.feed_direction=[0.0, 0.0, 1.0]", r"^cut.feed_direction: the feed direction \[0.0, 0.0, 1.0\] runs along"),
        ('cut.mode="down"', r"cut.mode: expected 'climb', 'up' or 'slot'; found the text 'down'"),
        ("place_m=[9.0, 0.0, 0.0]", r"^place_m: the tool cannot stand at 9, 0, 0 m at any angle: it is out of reach;"),
        ("limits_deg=[[-1,1],[-1,1],[-1,1],[-1,1],[-1,1],[-1,1]]", r"^place_m: .*: joint limits forbid every angle"),
        ("limits_deg=[[1,-1]]", r"^limits_deg: expected six pairs, lower limit before upper"),
        ("tool.spindle=[0.0,0.0,0.0]", r"^tool: the direction \[0.0, 0.0, 0.0\] has no length"),
        ('robot="l1_tape"', r"^limits_deg: is missing; expected lower and upper limit of six joints"),
        ("oscillator=[]", r"^oscillator: holds 0 angles; expected two or more, between which"),
        ("search.static_choice_deg=0.0", r"^search.static_choice_deg: is 0; expected an angle that is reachable and"),
        ("cutter.tooth_angles_deg=[0.0]", r"^cutter: tooth_angles has the shape \(1,\); expected 2 finite numbers"),
        ("modal={mass_kg=[1.0,1.0,1.0],damping_ratio=[0.1,0.1,0.1]}", r"^modal: found oscillator and modal; expected"),
        ("search.speed_range_rpm=[3000.0, 1000.0]", r"^search.speed_range_rpm: is 3000 to 1000; expected the lower"),
        ("lobes.to_rpm=100.0", r"^lobes.to_rpm: is 100; expected more than from_rpm, 600"),
    ],
)  # fmt: skip
def test_wrong_inputs_name_their_key(change, sentence) -> None:
    with pytest.raises(InputError, match=sentence):
        milling.solve(read(*BARE, change), Context())


def test_wrong_oscillators_name_their_row() -> None:
    rows = read().oscillator
    assert rows is not None
    bad = rows[1].model_copy(update={"k_N_m": [1e6, -1e6, 1e6]})
    with pytest.raises(InputError, match=r"^oscillator\[1\]: m, c and k must be positive"):
        milling.solve(bare(oscillator=[rows[0], bad]), Context())
    far = [row.model_copy(update={"angle_deg": 150.0 + n}) for n, row in enumerate(rows)]
    with pytest.raises(InputError, match=r"^oscillator: tells nothing of a reachable angle; it holds 150 to 152 deg"):
        milling.solve(bare(oscillator=far), Context())


def test_explain_and_stop() -> None:
    text = milling.explain(read(), Context())
    assert "361 angles, 1 places, 2 feeds, 5 speeds" in text and "the helix lags by 13.2 deg" in text
    stopped = Context(max_seconds=0.0)
    assert milling.solve(bare(), stopped).status is SolveStatus.INTERRUPTED
    assert np.isfinite(milling.solve(bare(), Context()).objective or np.nan)


@pytest.mark.parametrize(
    ("change", "key", "said"),
    [
        ("cutter.K_tc_Pa=903.77", "cutter.K_tc_Pa", "pascals"),
        ("cutter.diameter_m=25.4", "cutter.diameter_m", "not millimetres"),
        ("cut.feed_per_tooth_m=0.526", "cut.feed_per_tooth_m", "not millimetres"),
        ("cut.axial_depth_m=5.08", "cut.axial_depth_m", "not millimetres"),
        ("cut.speed_rpm=1e9", "cut.speed_rpm", "samples"),
    ],
)
def test_other_units_are_refused(change, key, said) -> None:
    with pytest.raises(InputError, match=said) as error:
        milling.solve(bare(change), Context())
    assert error.value.key == key


def test_what_the_report_leaves_open_is_said() -> None:
    def rows(*changes: str, **update) -> dict[str, str]:
        problem = bare(*changes, **update)
        search = problem.search.model_copy(update={"step_deg": 10.0})
        problem = problem.model_copy(update={"search": search})
        return {row.label: str(row.value) for row in milling.solve(problem, Context()).rows}

    usual = rows()
    assert "not steady" not in usual and "runout" not in usual["regenerative chatter"]
    # a tenth of a per cent of damping: two seconds from rest are not enough
    slack = [row.model_copy(update={"c_kg_s": [c / 100 for c in row.c_kg_s]}) for row in read().oscillator or []]
    assert "of the transient along" in rows(oscillator=slack)["not steady"]
    assert "without the runout" in rows("cutter.runout_m=[0, 2e-5]")["regenerative chatter"]
    uneven = rows("cutter.tooth_angles_deg=[0, 150]")["regenerative chatter"]
    assert uneven != usual["regenerative chatter"] and "without" not in uneven
    assert rows("cut.speed_rpm=6")["regenerative chatter"].startswith("not told")
