"""JSON Schemas for editors: shipped problems fit theirs; what gtmodel refuses at a key, the schema refuses there."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from gtmodel.problem_files import InputError, names
from gtmodel.problem_files.editor_schema import ROBOT, editor_schema, robot_schema, text_of, write_all
from gtmodel.problem_files.from_options import keys_of
from gtmodel.problem_files.load import apply, check
from gtmodel.problem_files.registry import schema_of
from gtmodel.problem_files.robot_file import FAMILIES, checked, is_robot_file
from tests.support.commands import Commands

TABLES = tomllib.loads(files("gtmodel.robots").joinpath("data", "gantry_tau.toml").read_text(encoding="utf-8"))
PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
SHIPPED = sorted(PROBLEMS.glob("*.toml"))
KEYWORDS = {"$schema", "title", "description", "default", "type", "enum", "const", "properties", "required", "items",
            "additionalProperties", "anyOf", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "minItems",
            "maxItems", "minLength"}  # fmt: skip


@pytest.fixture
def gtmodel(capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(capsys)


def validator(kind: str) -> jsonschema.Draft7Validator:
    return jsonschema.Draft7Validator(json.loads(text_of(kind)))


def nodes(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """A schema and all that it holds."""
    yield schema
    inner = [*schema.get("properties", {}).values(), *schema.get("anyOf", ())]
    inner += [schema[k] for k in ("items", "additionalProperties") if isinstance(schema.get(k), dict)]
    for one in inner:
        yield from nodes(one)


@pytest.mark.parametrize("kind", names())
def test_a_schema_is_one_of_draft_7_with_what_taplo_reads(kind: str) -> None:
    schema = editor_schema(kind)
    jsonschema.Draft7Validator.check_schema(schema)
    assert schema["$schema"] == "http://json-schema.org/draft-07/schema#"
    assert schema["properties"]["kind"]["const"] == kind and "kind" in schema["required"]
    for node in nodes(schema):
        assert set(node) <= KEYWORDS, set(node) - KEYWORDS
        assert node.get("type") != "null" and node.get("default", 0) is not None
        if "properties" in node:
            assert node["additionalProperties"] is False
            for name, key in node["properties"].items():
                assert key["title"] and (key["description"] or name == "title"), f"key '{name}' has no description"


@pytest.mark.parametrize("kind", names())
def test_every_key_is_there_with_unit_and_default(kind: str) -> None:
    """As `gtmodel schema` lists them; a default of a table stands at its keys."""
    schema = editor_schema(kind)
    for key in keys_of(schema_of(kind)):
        tables, last = [schema], []
        for part in key.key.split("."):
            name, several = part.removesuffix("[]"), part.endswith("[]")
            if name == "*":
                last = [v for table in tables if isinstance(v := table.get("additionalProperties"), dict)]
            else:
                last = [table["properties"][name] for table in tables if name in table.get("properties", {})]
            tables = [c for node in last for c in choices(node)]
            if several:
                tables = [c for node in tables if "items" in node for c in choices(node["items"])]
        assert last, key.key
        if key.unit:
            assert all(n["title"].endswith(f" [{key.unit}]") for n in last)
            assert all(n["description"].startswith(f"[{key.unit}] ") for n in last)


def choices(node: dict[str, Any]) -> list[dict[str, Any]]:
    return node.get("anyOf", [node])


def test_defaults_of_a_table_stand_at_its_keys() -> None:
    noise = editor_schema("calibration")["properties"]["joint_stiffness"]["properties"]["noise"]
    assert "default" not in noise and noise["properties"]["position_m"]["default"] == 2e-5
    axis = editor_schema("trajectory")["properties"]["mesh"]["properties"]
    assert axis["elements"]["default"] == schema_of("trajectory").model_fields["mesh"].default.elements


@pytest.mark.parametrize("kind", [*names(), ROBOT])
def test_shipped_schemas_are_current(kind: str) -> None:
    path = PROBLEMS / "schemas" / f"{kind}.schema.json"
    assert path.is_file(), f"problems/schemas/{path.name} is missing: run `make schemas`"
    assert path.read_text(encoding="utf-8") == text_of(kind), "run `make schemas`"


def test_no_schema_is_left_of_a_kind_that_has_gone(tmp_path: Path) -> None:
    assert {p.name for p in (PROBLEMS / "schemas").iterdir()} == {p.name for p in write_all(tmp_path)}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_a_shipped_problem_names_its_schema_and_fits_it(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    data = tomllib.loads(text)
    header = re.match(r"(?:#.*\n)+", text)  # taplo looks for the line among the comments at the top
    assert header and f"#:schema ./schemas/{data['kind']}.schema.json\n" in header[0]
    assert text.startswith(("#:schema", "# The recording is not shipped"))
    assert [f"{e.json_path}: {e.message}" for e in validator(data["kind"]).iter_errors(data)] == []


# problem, what is changed, the key at which gtmodel refuses it
WRONG = [
    ("l1_min_time", "mesh.elemnts=20", "mesh.elemnts"),
    ("l1_min_time", "mesh.elements=0", "mesh.elements"),
    ("l1_min_time", "mesh.elements=20.5", "mesh.elements"),
    ("l1_min_time", "mesh.elements=many", "mesh.elements"),
    ("l1_min_time", "limits.force_N=-1.0", "limits.force_N"),
    ("l1_min_time", "limits.force=500", "limits.force"),
    ("l1_min_time", "start.tcp_m=[0.0, 1.0]", "start.tcp_m"),
    ("l1_min_time", "start.rest=[\"speed\"]", "start.rest[0]"),
    ("l1_min_time", "robot=3", "robot"),
    ("l1_min_time", "goal=5", "goal"),
    ("l1_min_time", "path.shape=zigzag", "path.shape"),
    ("l1_min_time", "forces_N=1", "forces_N"),
    ("l1_controller", "real=half", "real"),
    ("l1_controller", "functions.0.targets=[]", "functions[0].targets"),
    ("l1_controller", "functions.0.name=", "functions[0].name"),
    ("l1_controller", "check.points=0", "check.points"),
    ("l1_controller", "functions=none", "functions"),
    ("simulate_l1", "final_time_s=0", "final_time_s"),
    ("simulate_l1", "tolerance=1", "tolerance"),
    ("simulate_l1", "method=euler", "method"),
    ("simulate_l1", "prefer=T", "prefer"),
    ("compliance_l1", "payload_kg=-2.0", "payload_kg"),
    ("calibrate_hexapod", "measurements={}", "measurements.file"),
    ("calibrate_hexapod", "held_out.every=-1", "held_out.every"),
    ("calibrate_hexapod", "measurements.target=1", "measurements.target"),
    ("calibrate_hexapod", "priors.A.std=0", "priors.A.std"),
    ("emps", "log.position.column=1", "log.position.column"),
    ("emps", "log.jitter=1.0", "log.jitter"),
    ("emps", "log.effort.scale=free", "log.effort.scale"),
    ("emps", "nonnegative=3", "nonnegative"),
    ("vibration_step", "nosuch.table=1", "nosuch"),
    ("friction_l1", "kind=7", "kind"),
]  # fmt: skip


def dotted(place: list[str | int]) -> str:
    return "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in place).removeprefix(".")


@pytest.mark.parametrize(("problem", "setting", "key"), WRONG, ids=lambda w: str(w))
def test_what_gtmodel_refuses_the_schema_refuses_at_the_same_key(problem: str, setting: str, key: str) -> None:
    data = tomllib.loads((PROBLEMS / f"{problem}.toml").read_text(encoding="utf-8"))
    kind = data["kind"]
    wrong = apply(data, [setting])
    with pytest.raises(InputError) as caught:
        check(wrong)
    assert caught.value.key == key
    places = set()
    for error in validator(kind).iter_errors(wrong):
        place = dotted(list(error.absolute_path))
        if error.validator == "additionalProperties":
            places |= {f"{place}.{k}".removeprefix(".") for k in set(error.instance) - set(error.schema["properties"])}
        elif error.validator == "required":
            places |= {f"{place}.{k}".removeprefix(".") for k in error.validator_value if k not in error.instance}
        else:
            places.add(place)
    assert key in places


def test_the_command_prints_a_file_for_editors(gtmodel: Commands) -> None:
    done = gtmodel("schema", "compliance", "--json-schema")
    assert done.code == 0 and done.out == text_of("compliance") and done.out.isascii()
    assert (PROBLEMS / "schemas" / "compliance.schema.json").read_text() == done.out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--json-schema"], "--json-schema needs a kind: trajectory, axis_trajectory"),
        (["compliance", "--json-schema", "--json"], "--json-schema is JSON already; leave --json out"),
        (["complaince", "--json-schema"], "there is no kind 'complaince'; did you mean 'compliance'?"),
    ],
)
def test_wrong_words(gtmodel: Commands, words: list[str], sentence: str) -> None:
    done = gtmodel("schema", *words)
    assert done.code == 2 and sentence in done.sentence and not done.out


ARM = {"family": "serial", "a_m": [0.3, 0.2], "alpha_deg": [0.0, 90.0], "d_m": [0.1, 0.0]}
CALIBRATED = {"title": "mine", "robot": "hexapod.py:Hexapod", "parameters": {"L": [1.0, 1.1]}}


def printed(name: str, family: str) -> dict[str, Any]:
    """A robot file with a printed table."""
    return {**TABLES[name], "family": family}


ROBOTS = [
    printed("l1_tape", "three_link"), printed("d1_six_link", "six_link"), printed("f1", "f1"), ARM, CALIBRATED,
    {k: v for k, v in printed("l1_tape", "three_link").items() if k != "family"},
]  # fmt: skip


@pytest.mark.parametrize("data", ROBOTS, ids=range(len(ROBOTS)))
def test_robot_files_fit_their_schema(data: dict[str, Any]) -> None:
    assert is_robot_file(data)
    assert list(validator(ROBOT).iter_errors(data)) == []


@pytest.mark.parametrize(
    ("data", "changes"),
    [
        *((robot, {"nosuch": 1}) for robot in ROBOTS),
        *((robot, {"title": 3}) for robot in ROBOTS),
        (ROBOTS[0], {"L_m": [1.0, 2.0]}),
        (ROBOTS[0], {"L_m": [1.0, 2.0, -1.0]}),
        (ROBOTS[0], {"family": "six_link"}),
        (ROBOTS[1], {"family": "three_link"}),
        (ARM, {"convention": "other"}),
        (CALIBRATED, {"robot": 1}),
    ],
)
def test_a_wrong_robot_file_does_not_fit(data: dict[str, Any], changes: dict[str, Any]) -> None:
    assert list(validator(ROBOT).iter_errors({**data, **changes}))
    if data is not CALIBRATED:
        with pytest.raises(InputError):
            checked({**data, **changes})


def test_the_schema_of_robot_files_has_every_family_and_what_taplo_reads() -> None:
    schema = robot_schema()
    jsonschema.Draft7Validator.check_schema(schema)
    families = [one["properties"]["family"]["const"] for one in schema["anyOf"] if "family" in one["properties"]]
    assert families == list(FAMILIES)
    for node in nodes(schema):
        assert set(node) <= KEYWORDS, set(node) - KEYWORDS
    assert schema["anyOf"][0]["properties"]["L_m"]["title"] == "L [m]"


def test_the_command_prints_the_schema_of_robot_files(gtmodel: Commands) -> None:
    assert gtmodel("schema", ROBOT, "--json-schema").out == text_of(ROBOT)
