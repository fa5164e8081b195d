"""Problem files: what is read, what `--set` changes, and the sentence for every fault."""

from pathlib import Path
from typing import Any, Literal

import pytest
from pydantic import Field

from gtmodel.problem_files import FileSection, InputError, Problem, load
from gtmodel.problem_files.files import parse
from gtmodel.problem_files.from_options import keys_of
from gtmodel.problem_files.load import apply, check, validate
from gtmodel.results.quantity import split

LOAD = load.load

KINDS = 'write kind = "trajectory", or another kind that gtmodel schema lists'


class Limits(FileSection):
    force_N: float = Field(gt=0, description="largest force")
    angle_rad: list[float] = Field(default=[0.0, 1.0], min_length=2, max_length=2, description="range")


class Part(FileSection):
    name: str = Field(description="its name")
    mass_kg: float | list[float] = Field(default=1.0, description="one, or one per body")


class Schema(Problem):
    limits: Limits
    law: Literal["linear", "cubic"] = Field(default="linear", description="friction law")
    count: int = Field(default=3, ge=1, description="how many")
    exact: bool = Field(default=False, description="whether")
    parts: list[Part] = Field(default=[], description="bodies")
    limit_speed_m_s: float | None = Field(default=None, description="largest speed")


GOOD: dict[str, Any] = {"kind": "test", "limits": {"force_N": 1.0}, "parts": [{"name": "a"}, {"name": "b"}]}

FAULTS = [
    ("limits.force_kN=3", "limits.force_kN: unknown key; did you mean 'force_N' (N)?"),
    ("limits.fore_N=3", "limits.fore_N: unknown key; did you mean 'force_N' (N)?"),
    ("limits.force=3", "limits.force: unknown key; did you mean 'force_N' (N)?"),
    ("limits.zzz=3", "limits.zzz: unknown key; there are force_N, angle_rad"),
    ("limit_speed_km_s=3", "limit_speed_km_s: unknown key; did you mean 'limit_speed_m_s' (m/s)?"),
    ("force_N=3", "force_N: unknown key here; did you mean 'limits.force_N'?"),
    ("lmits.force_N=3", "lmits: unknown key; did you mean 'limits'?"),
    ("parts.1.mass_g=3", "parts[1].mass_g: unknown key; did you mean 'mass_kg' (kg)?"),
    ("parts.1.nme=x", "parts[1].nme: unknown key; did you mean 'name'?"),
    ("parts.2.name=x", "parts.2.name: has 2 entries; '2' is not a number from 0 to 1"),
    ("limits.force_N=much", "limits.force_N: expected a number in N; found the text 'much'"),
    ("limits.force_N='3'", "limits.force_N: expected a number in N; found the text '3'"),
    ("limits.force_N=true", "limits.force_N: expected a number in N; found true"),
    ("limits.force_N=0", "limits.force_N: must be greater than 0 N; found 0"),
    ("limits.force_N=inf", "limits.force_N: expected a finite number in N; found inf"),
    ("limits.force_N=[1.0]", "limits.force_N: expected a number in N; found [1.0]"),
    ("limits={}", "limits.force_N: is missing; expected a number > 0 in N (largest force)"),
    ("limits=3", "limits: expected a table; found 3"),
    ("limits.angle_rad=3", "limits.angle_rad: expected a list of 2 numbers in rad; found 3"),
    ("limits.angle_rad=[1]", "limits.angle_rad: expected a list of 2 numbers in rad; found [1]"),
    ("limits.angle_rad=[1,'a']", "limits.angle_rad[1]: expected a number in rad; found the text 'a'"),
    ("parts.0.mass_kg=x", "parts[0].mass_kg: expected a number or list of numbers in kg; found the text 'x'"),
    ("law=quartic", "law: expected 'linear' or 'cubic'; found the text 'quartic'"),
    ("count=2.5", "count: expected a whole number; found 2.5"),
    ("count=0", "count: must be greater than or equal to 1; found 0"),
    ("exact=1", "exact: expected true or false; found 1"),
    ("title=3", "title: expected a text; found 3"),
    ("limits.force_N.x=3", "limits.force_N.x: cannot be set: 'limits.force_N' is 1.0, not a table"),
    ("=3", "--set =3: expected key=value, such as --set limits.force_N=500"),
    ("limits..x=3", "--set limits..x=3: expected key=value, such as --set limits.force_N=500"),
]


@pytest.mark.parametrize(("setting", "sentence"), FAULTS, ids=[setting for setting, _ in FAULTS])
def test_every_fault_is_one_sentence_with_its_key(setting: str, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        validate(Schema, apply(GOOD, [setting]))
    assert str(caught.value) == sentence


def test_further_faults_are_named_behind_the_first() -> None:
    with pytest.raises(InputError, match=r"unknown key; .*; also wrong: count$") as caught:
        validate(Schema, apply(GOOD, ["count=no", "limits.mass=3"]))
    assert caught.value.key == "limits.mass"


def test_unknown_missing_and_wrong_keys_are_told_apart() -> None:
    with pytest.raises(InputError, match=r"; also unknown: weight; also missing: limits.force_N; also wrong: count"):
        validate(Schema, {"kind": "test", "weight": 1, "limits": {"mass": 3}, "count": "no"})


def test_a_missing_table_names_the_keys_that_it_needs() -> None:
    with pytest.raises(InputError, match=r"^limits: is missing; expected a table with force_N$"):
        validate(Schema, {"kind": "test"})


def test_a_misspelt_key_is_not_missing_as_well() -> None:
    with pytest.raises(InputError) as caught:
        validate(Schema, {"kind": "test", "limits": {"force_kN": 1.0}})
    assert "also wrong" not in str(caught.value)


def test_settings_are_toml_or_text_and_leave_the_data_alone() -> None:
    changed = apply(GOOD, ["limits.force_N=2", "parts.1.name=c d", "title = a # b", "exact=true", "exact=false"])
    problem = validate(Schema, changed)
    assert problem.limits.force_N == 2.0 and problem.parts[1].name == "c d" and problem.exact is False
    assert problem.title == "a # b"
    assert GOOD["limits"]["force_N"] == 1.0 and "exact" not in GOOD


def test_settings_cannot_smuggle_a_second_key() -> None:
    assert apply({}, ["title=1\nkind='x'"]) == {"title": "1\nkind='x'"}


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"kind = ", "line 1: not TOML: remove a key that has no value; found 'kind ='"),
        (b"a = 1\n\nb == 2\n", "line 3: not TOML: set a key with one =; found 'b == 2'"),
        (b"a = 1\na = 2\n", "line 2: not TOML: the key appears twice; found 'a = 2'"),
        (b'a = 1\nt = "\xff"', "line 2: not UTF-8 text; save the file as UTF-8"),
    ],
)
def test_what_is_no_toml_names_its_line(content: bytes, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(content)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ({}, f"kind: is missing; {KINDS}"),
        ({"kind": 3}, f"kind: expected a text; found 3; {KINDS}"),
        ({"kind": "trajctory"}, "kind: there is no kind 'trajctory'; did you mean 'trajectory'?"),
    ],
)
def test_the_kind_must_be_named(data: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        check(data)
    assert str(caught.value) == sentence


def test_a_faulty_file_is_named_as_it_was_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("kind = 'trajectory'\nrobot = 3\n")
    with pytest.raises(InputError, match=r"^mine\.toml: robot: expected a text; found 3; also missing: start, goal"):
        LOAD("mine.toml")
    with pytest.raises(InputError, match=r"^\.: is a folder; name a TOML file$"):
        LOAD(".")
    with pytest.raises(InputError, match=r"^problems/l1_min_time\.toml: limits\.force_N: must be greater"):
        LOAD("problems/l1_min_time.toml", ["limits.force_N=0"])


def test_a_file_here_wins_over_a_shipped_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert LOAD("l1_min_time").shipped and LOAD("problems/l1_min_time.toml").shipped
    shipped = LOAD("l1_min_time")
    (tmp_path / "l1_min_time.toml").write_bytes(shipped.content)
    assert not LOAD("l1_min_time.toml").shipped


def test_keys_carry_type_unit_and_default() -> None:
    keys = {key.key: key for key in keys_of(Schema)}
    assert keys["limits.force_N"][1:4] == ("number > 0", "N", "required")
    assert keys["limits.angle_rad"][1:4] == ("list of 2 numbers", "rad", "[0.0, 1.0]")
    assert keys["parts[].name"][1:4] == ("text", "", "required in [[parts]]")
    assert keys["law"].type == '"linear" or "cubic"' and keys["limit_speed_m_s"][1:4] == ("number", "m/s", "")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("force_N", ("force", "N")),
        ("velocity_scale_m_s", ("velocity_scale", "m/s")),
        ("force_unit_N", ("force_unit", "N")),
        ("noise_m_s2", ("noise", "m/s2")),
        ("error_percent", ("error", "%")),
        ("torque_Nm", ("torque", "N.m")),
        ("compliance_m_per_N", ("compliance", "m/N")),
        ("range_noise_um_per_m", ("range_noise", "um/m")),
        ("device_per_session", ("device_per_session", "")),
        ("points", ("points", "")),
        ("model_2", ("model_2", "")),
        ("distance_min", ("distance_min", "")),
        ("max_iterations", ("max_iterations", "")),
        ("N", ("N", "")),
    ],
)
def test_units_in_names(name: str, expected: tuple[str, str]) -> None:
    assert split(name) == expected
