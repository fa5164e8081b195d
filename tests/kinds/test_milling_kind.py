"""Kind "milling": the shipped problem, a field in a file, and what is refused, with its key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtmodel.milling import PathOffset, study
from gtmodel.problem_files import Context
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus
from gtmodel.results.as_json import plain
from gtmodel.robots import kr500, kr500_tables
from gtmodel.vibration import fit_oscillator_field, oscillator_text
from tests.milling.shipped import GIVEN, PRINTED_CHOICE, RPM
from tests.milling.thesis import CUT, CUTTER, OSCILLATORS
from tests.support.refusals import key_of_refusal

PROBLEM = "problems/milling_pose.toml"
# only the shipped problem does all; the others leave out what they do not ask for
BARE = ("printed_tests=false", "search.speeds_rpm=[]", "search.feed_directions=[]", "search.refine=0")


def solved(*changes: str, context: Context | None = None):
    return answer(load(PROBLEM, list(changes)), context or Context())


def test_the_shipped_problem_gives_what_the_call_gives() -> None:
    found = solved()
    assert found.status is SolveStatus.SOLVED and all(check.passed for check in found.checks.values())
    assert len(found.values["combinations"]) == 10 and len(found.values["printed_mean_mm"]["+x"]) == 12
    search = replace(
        PRINTED_CHOICE, refine=3, speeds=[n * RPM for n in (1500, 1725, 2400, 3225)],
        feed_directions=[[0.0, 1.0, 0.0]], speed_range=[1200 * RPM, 3600 * RPM],
    )  # fmt: skip
    options = {**GIVEN, "search": search, "lobes": (600 * RPM, 6000 * RPM), "compensation": PathOffset()}
    called = study(kr500(), CUTTER, CUT, tests=kr500_tables(), **options)
    assert plain(found.values) == plain(called.values)


ROWS = "".join(
    f"[[oscillator]]\nangle_deg={49 + n}\nm_kg=[170.0, 100.0, 280.0]\nc_kg_s=[4000.0, 6500.0]\nk_N_m=[3e6, {k}, 1e6]\n"
    for n, k in enumerate(("5e6", "-1e6"))
)


def written(tmp_path, dynamics: str):
    """The shipped problem with other dynamics, bare; what it was given."""
    text, _, _ = Path(PROBLEM).read_text().partition("# Table 16")
    text = text.replace("printed_tests = true", "" if dynamics.startswith("[") else dynamics)
    tables = dynamics if dynamics.startswith("[") else ""
    (tmp_path / "problem.toml").write_text(f"{text}{tables}[search]\nrefine = 0\nstep_deg = 10.0\n")
    context = Context(folder=tmp_path)
    return answer(load(str(tmp_path / "problem.toml")), context), context.inputs


def test_a_field_in_a_file_is_read_beside_the_problem(tmp_path) -> None:
    o, angles = OSCILLATORS[np.array([3, 1, 0, 5, 4, 9])], np.deg2rad([49.0, 52.0, 110.0, 45.0, 110.0, 53.0])
    x, y = np.array([[-0.01073] * 3 + [0.6159] * 2 + [-0.00025], [-2.40047] * 5 + [-2.11124]])
    poses = np.column_stack([x, y, np.full(6, 0.30341), angles])
    field, _ = fit_oscillator_field(poses, o.m, o.c, o.k, starts=1, calibrate=False, synthetic="six poses")
    (tmp_path / "field.toml").write_text(oscillator_text(field), encoding="utf-8")
    line = 'oscillator_field = "field.toml"'
    found, inputs = written(tmp_path, line)
    assert found.dynamics == "Gaussian processes over the pose, field.toml; synthetic: six poses"
    assert inputs == {"oscillator_field": tmp_path / "field.toml"}
    (tmp_path / "field.toml").unlink()
    assert key_of_refusal(lambda: written(tmp_path, line)) == "oscillator_field"


def test_dynamics_from_masses_and_rows(tmp_path) -> None:
    modal = "[modal]\nmass_kg = [170.0, 100.0, 280.0]\ndamping_ratio = [0.09, 0.1, 0.09]\n"
    assert "not a measurement" in written(tmp_path, modal)[0].dynamics
    assert key_of_refusal(lambda: written(tmp_path, ROWS)) == "oscillator[1]"


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ("cutter.diameter_mm=25.4", "cutter.diameter_mm"),
        ("cut.radial_depth_m=0.03", "cut.radial_depth_m"),
        ("cut.feed_per_tooth_m=-0.0005", "cut.feed_per_tooth_m"),
        ("cut.speed_rpm=0.0", "cut.speed_rpm"),
        ("search.speeds_rpm=[100.0, -1.0]", "search.speeds_rpm[1]"),
        ("cut.feed_direction=[0.0, 0.0, 1.0]", "cut.feed_direction"),
        ('cut.mode="down"', "cut.mode"),
        ("place_m=[9.0, 0.0, 0.0]", "place_m"),
        ("limits_deg=[[-1,1],[-1,1],[-1,1],[-1,1],[-1,1],[-1,1]]", "place_m"),
        ("limits_deg=[[1,-1]]", "limits_deg"),
        ("tool.spindle=[0.0,0.0,0.0]", "tool"),
        ('robot="l1_tape"', "limits_deg"),
        ("oscillator=[]", "oscillator"),
        ("search.static_choice_deg=0.0", "search.static_choice_deg"),
        ("cutter.tooth_angles_deg=[0.0]", "cutter.tooth_angles_deg"),
        ("modal={mass_kg=[1.0,1.0,1.0],damping_ratio=[0.1,0.1,0.1]}", "modal"),
        ("search.speed_range_rpm=[3000.0, 1000.0]", "search.speed_range_rpm"),
        ("lobes.to_rpm=100.0", "lobes.to_rpm"),
        ("cutter.K_tc_Pa=903.77", "cutter.K_tc_Pa"),
        ("cutter.diameter_m=25.4", "cutter.diameter_m"),
        ("cut.feed_per_tooth_m=0.526", "cut.feed_per_tooth_m"),
        ("cut.axial_depth_m=5.08", "cut.axial_depth_m"),
        ("cut.speed_rpm=1e9", "cut.speed_rpm"),
    ],
)
def test_wrong_inputs_name_their_key(change, key) -> None:
    assert key_of_refusal(lambda: solved(*BARE, change)) == key


def test_explain_and_time_limit() -> None:
    text = explain(load(PROBLEM), Context())
    assert "361 angles, 1 places, 2 feeds, 5 speeds" in text and "the helix lags by 13.2 deg" in text
    assert solved(*BARE, context=Context(max_seconds=0.0)).status is SolveStatus.INTERRUPTED
