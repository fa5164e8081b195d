"""Robot files of all families, the kinds that take only some, and the command line on the F1 and the six-link D1."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from gtmodel._files import problems_dir
from gtmodel.problem_files import Context, InputError, explaining, files as listing
from gtmodel.problem_files.load import load
from gtmodel.problem_files.robot_file import FAMILIES
from gtmodel.problem_files.robots import resolve
from gtmodel.problem_files.run import context_of, solve
from gtmodel.robots import catalogue

TABLES = tomllib.loads(files("gtmodel.robots").joinpath("data", "gantry_tau.toml").read_text(encoding="utf-8"))
COPIES = {"l1_tape": "three_link", "d1_six_link": "six_link", "f1": "f1"}


def written(folder: Path, name: str, **changes: object) -> Context:
    """A robot file robot.toml with the printed table, its family and changed keys; None takes a key out."""
    data = {**TABLES[name], "family": COPIES[name], **changes}
    (folder / "robot.toml").write_text(tomli_w.dumps({k: v for k, v in data.items() if v is not None}))
    return Context(folder=folder)


def refusal(folder: Path, name: str, **changes: object) -> str:
    with pytest.raises(InputError) as caught:
        resolve("robot.toml", written(folder, name, **changes))
    return str(caught.value)


@pytest.mark.parametrize("name", COPIES)
def test_a_copy_of_a_printed_table_is_that_robot(tmp_path: Path, name: str) -> None:
    mine, printed = resolve("robot.toml", written(tmp_path, name, prototype="mine")), catalogue.make(name)
    assert type(mine) is type(printed)
    more = {"three_link": [], "six_link": ["B"], "f1": ["A0", "B", "u1_2", "u1_3", "u2_3", "r3"]}
    geometry = ["A", "v", "L", *more[COPIES[name]]]
    for parameter in geometry:
        assert np.array_equal(getattr(mine, parameter), getattr(printed, parameter))


@pytest.mark.parametrize("name", ["d1_six_link", "f1"])
def test_masses_of_the_file_and_payload(tmp_path: Path, name: str) -> None:
    plain = resolve("robot.toml", written(tmp_path, name), payload=1.5)
    heavy = resolve("robot.toml", written(tmp_path, name, m_p_kg=30.0, c_p_m=[0.0, 0.0, 0.1]), payload=1.5)
    assert plain.m_p == pytest.approx(13.5) and heavy.m_p == pytest.approx(31.5)  # 12 kg: an example of ours
    assert heavy.c_p == [0.0, 0.0, 0.1]


def test_a_home_of_ones_own(tmp_path: Path) -> None:
    turned = resolve(
        "robot.toml", written(tmp_path, "d1_six_link", home_m=[-1.0, -4.2, 0.1], home_zyz_deg=[85, 101, -89])
    )
    fitted = resolve("robot.toml", written(tmp_path, "d1_six_link"))
    assert np.array_equal(turned.home, [-1.0, -4.2, 0.1])
    assert abs(abs(np.dot(turned.home_e, fitted.home_e)) - 1.0) < 1e-4
    f1 = resolve("robot.toml", written(tmp_path, "f1", home_mm=[-100.0, 2300.0, 50.0]))
    assert np.array_equal(f1.home, [-0.1, 2.3, 0.05])


@pytest.mark.parametrize(
    ("name", "changes", "sentence"),
    [
        (
            "f1",
            {"family": "six_links"},
            "family: expected one of three_link, six_link, f1, serial; found the text 'six_links'; did",
        ),
        ("f1", {"family": 1}, "family: expected one of three_link, six_link, f1, serial; found 1"),
        ("f1", {"family": None}, 'family: is missing; a file with A0_mm needs family = "f1"'),
        ("d1_six_link", {"family": None}, 'family: is missing; a file with B_m needs family = "six_link"'),
        ("d1_six_link", {"B_m": None}, "B_m: is missing; expected a list of 6 lists of 3 numbers in m (plate joints"),
        ("d1_six_link", {"L_m": [1.0] * 3}, "L_m: expected a list of 6 numbers > 0 in m; found [1.0, 1.0, 1.0]"),
        ("d1_six_link", {"family": "three_link"}, "unknown key"),
        ("f1", {"u1_2": [1.0, 0.0, 0.0]}, "u1_2: expected a list of 4 numbers; found [1.0, 0.0, 0.0]"),
        ("f1", {"r3_m": [0.0, 0.0, 0.0], "r3_mm": None}, "r3_m: unknown key; did you mean 'r3_mm' (mm)?"),
        (
            "f1",
            {"u1_2": [0.6308, 0.0054, 0.0054, 0.7467]},
            "u1_2: the links of a cluster deviate from parallel by 151 mm",
        ),
        ("d1_six_link", {"links": ["1", "2b", "2a", "3a", "3b", "3c"]}, "links: must be 1, 2a, 2b, 3a, 3b, 3c in this"),
        ("f1", {"I_p_kg_m2": [1.0]}, "I_p_kg_m2[0]: expected a list of 3 numbers in kg.m2; found 1.0"),
        (
            "f1",
            {"A0_mm": [[1.0, 2.0]] * 3},
            "A0_mm[0]: expected a list of 3 numbers in mm; found [1.0, 2.0]; also wrong",
        ),
        ("l1_tape", {"A_m": [[1.0] * 4, [0.0] * 3, [0.0] * 3]}, "A_m[0]: expected a list of 3 numbers in m; found [1"),
    ],
)
def test_faults_are_sentences(tmp_path: Path, name: str, changes: dict[str, object], sentence: str) -> None:
    found = refusal(tmp_path, name, **changes)
    assert found.startswith("robot: robot.toml: ") and sentence in found


@pytest.mark.parametrize(
    ("name", "key", "factor", "sentence"),
    [
        ("f1", "L_mm", 1e-3, "L_mm: link lengths from 1.50119 to 1.92258 mm look like metres; give millimetres"),
        ("f1", "A0_mm", 1e-3, "A0_mm: coordinates up to 3.2989 mm look like metres; give millimetres"),
        ("f1", "B0_mm", 1e-3, "B0_mm: coordinates up to 0.30928 mm look like metres; give millimetres"),
        ("f1", "A_bj_mm", 1e-3, "A_bj_mm: coordinates up to 0.18736 mm look like metres; give millimetres"),
        ("f1", "r3_mm", 1e-3, "r3_mm: coordinates up to 0.1219 mm look like metres; give millimetres"),
        ("f1", "L_mm", 1e3, "look like micrometres; give millimetres"),
        ("d1_six_link", "L_m", 1e3, "L_m: link lengths from 2042.91 to 2044.22 m look like millimetres; give metres"),
        ("d1_six_link", "A_m", 1e3, "A_m: coordinates up to 4968.29 m look like millimetres; give metres"),
        ("d1_six_link", "B_m", 1e3, "B_m: coordinates up to 189.26 m look like millimetres; give metres"),
        ("d1_six_link", "L_m", 1e-3, "L_m: link lengths from 0.00204291 to 0.00204422 m are too short for a robot"),
        ("l1_tape", "L_m", 30.0, "L_m: link lengths from 54.3 to 61.5 m look like millimetres; give metres"),
        ("l1_tape", "L_m", 1e3, "L_m: link lengths from 1810 to 2050 m look like millimetres; give metres"),
    ],
)
def test_lengths_in_another_unit(tmp_path: Path, name: str, key: str, factor: float, sentence: str) -> None:
    changed = (factor * np.array(TABLES[name][key])).tolist()
    assert sentence in refusal(tmp_path, name, **{key: changed})


@pytest.mark.parametrize(("name", "rows"), [("l1_tape", 3), ("d1_six_link", 6), ("f1", 1)])
@pytest.mark.parametrize("factor", [0.0, 1e-3, 1e3])
def test_a_guideway_moves_its_cart_by_about_q(tmp_path: Path, name: str, rows: int, factor: float) -> None:
    v = np.array(TABLES[name]["v"], dtype=float).reshape(rows, 3)
    for k in range(rows):
        changed = v * np.where(np.arange(rows) == k, factor, 1.0)[:, None]
        said = refusal(tmp_path, name, v=changed.tolist() if rows > 1 else changed[0].tolist())
        assert f"v: row {k + 1} moves its cart joint by " in said and "per metre of q; expected about 1" in said


@pytest.mark.parametrize("row", [1, 2, 3, 5])
def test_links_of_one_cart_move_alike(tmp_path: Path, row: int) -> None:
    v = np.array(TABLES["d1_six_link"]["v"])
    v[row] *= -1.0
    assert "on one cart, but their rows differ by 200 %" in refusal(tmp_path, "d1_six_link", v=v.tolist())


def test_a_row_of_another_link_is_found_by_the_fit(tmp_path: Path) -> None:
    B = TABLES["d1_six_link"]["B_m"]
    found = refusal(tmp_path, "d1_six_link", B_m=[*B[:3], B[4], B[3], B[5]])
    assert "deviate from parallel by" in found and "give home_zyz_deg" in found
    home = [85.0, 100.9, -88.6]
    assert resolve("robot.toml", written(tmp_path, "d1_six_link", home_zyz_deg=home)).home_e is not None


def test_options_that_fit_three_links_only(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"^inertia: inertia model 'model_1' applies to three-link robots only; give the masses of 'f1'",
    ):
        resolve("f1", Context(), inertia="model_1")
    assert resolve("f1", Context(), smoothing="piecewise_linear").cart is not None


def test_a_trajectory_of_the_f1_is_refused_in_one_sentence(tmp_path: Path) -> None:
    problem = (problems_dir() / "l1_min_time.toml").read_text(encoding="utf-8")
    plain = tmp_path / "motion.toml"
    plain.write_text(problem.replace('inertia = "model_2"', ""))
    for path, sentence in (
        ("problems/l1_min_time.toml", r"^inertia: inertia model 'model_2' applies to three-link robots only"),
        (str(plain), r"^robot: has 6 motors .* robots with 3; .*axis_trajectory"),
    ):
        loaded = load(path, ['robot="f1"'])
        with pytest.raises(InputError, match=sentence):
            solve(loaded, context_of(loaded))


def test_explain_and_list() -> None:
    assert "SixLink: T from q" in explaining.of("d1_six_link", ["q"], ["T"])
    robots = listing.of("robots")["robots"]
    assert robots["f1"] == {
        "family": "f1",
        "degrees_of_freedom": 6,
        "source": "Dressler 2012, Table 5.5",
        "masses": "an example of ours",
    }
    assert {*FAMILIES} == {entry["family"] for entry in robots.values()}


def test_explain_takes_a_robot_file(tmp_path: Path) -> None:
    written(tmp_path, "f1")
    text = explaining.of(str(tmp_path / "robot.toml"), ["q"], ["T"])
    assert text.startswith("F1: T from q") and "Newton in T[0], T[1], T[2], e[0], e[1], e[2], e[3]" in text
