"""A kind that a developer adds: the sample of ARCHITECTURE.md works, and what is missing in a kind is one sentence."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

import gtmodel as gt
from gtmodel.problem_files import InputError
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.load import load
from gtmodel.problem_files.registry import _KINDS, results_of, schema_of
from gtmodel.problem_files.run import answer, explain
from tests.kinds.conftest import is_key

ARCHITECTURE = Path(__file__).resolve().parents[2] / "ARCHITECTURE.md"
PROBLEM = """kind = "stiffness"
robot = "l1_tape"
[links]
stiffness_N_m = 2e7
[section]
step_m = 0.4
"""


@pytest.fixture
def sample(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The kind of ARCHITECTURE.md, as if it were in kinds/ and in the registry."""
    (text,) = re.findall(r'^```python\n("""Kind .*?)^```$', ARCHITECTURE.read_text(encoding="utf-8"), re.M | re.S)
    module = ModuleType("gtmodel.kinds.stiffness")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setitem(_KINDS, "stiffness", "stiffness of a parallel robot")
    exec(compile(text, str(ARCHITECTURE), "exec"), vars(module))
    return module


def test_the_sample_of_architecture_is_a_whole_kind(sample: ModuleType, tmp_path: Path) -> None:
    file = tmp_path / "p.toml"
    file.write_text(PROBLEM)
    study = answer(load(file), Context())
    assert isinstance(study, gt.compliance.ComplianceStudy) and study.status.ok
    assert results_of("stiffness") == [gt.compliance.ComplianceStudy] and schema_of("stiffness") is sample.Schema
    shown = explain(load(file), Context()).splitlines()
    assert (
        shown[0] == "stiffness" and "  links.stiffness_N_m = 20000000.0" in shown and not any("{" in s for s in shown)
    )


@pytest.mark.parametrize(
    ("setting", "key"),
    [("links.parallel=[1]", "links"), ("section.step_m=1e-6", "section.step_m"), ("robot='kr500'", "robot")],
)
def test_its_refusals_name_keys(sample: ModuleType, tmp_path: Path, setting: str, key: str) -> None:
    file = tmp_path / "p.toml"
    file.write_text(PROBLEM)
    with pytest.raises(InputError) as caught:
        answer(load(file, [setting]), Context())
    assert caught.value.key == key and is_key(sample.Schema, key)


def test_a_result_that_is_missing_or_not_exported_is_one_sentence(
    sample: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sample, "RESULT", "gtmodel.kinematics.ReachStudy")
    with pytest.raises(InputError) as caught:
        results_of("stiffness")
    assert str(caught.value) == (
        "gtmodel/kinds/stiffness.py: RESULT names gtmodel.kinematics.ReachStudy, "
        "which gtmodel/kinematics/__init__.py does not export"
    )
    for name in ("RESULT", "Schema"):
        monkeypatch.delattr(sample, name)
        with pytest.raises(InputError, match=rf"gtmodel/kinds/stiffness\.py defines no {name}"):
            results_of("stiffness") if name == "RESULT" else schema_of("stiffness")


def test_a_key_is_recognised_below_lists_and_free_names() -> None:
    schema = schema_of("calibration")
    assert is_key(schema, "measurements[1].signals.n.unit") and is_key(schema, "measurements[1].signals.n")
    assert is_key(schema, "robot") and not is_key(schema, "known") and not is_key(schema, "robot.x")
