"""The README is true: its demo table is what the problem gives, its Python runs as printed."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files.log_keys import MeasuredSignalSection

CLONE = Path(__file__).parents[1]
README = (CLONE / "README.md").read_text(encoding="utf-8")
# printed to six digits; other optima of the same quality lie a few 1e-5 apart on another processor
PRINTED = 5e-4


def test_demo_table_and_prose_hold_the_numbers_of_the_problem() -> None:
    command = [sys.executable, "-m", "gtmodel.cli", "solve", "problems/l1_min_time.toml", "--json"]
    values = json.loads(subprocess.run(command, cwd=CLONE, capture_output=True, check=True).stdout)["values"]
    names = {
        "final time": ("exported_final_time_s", 1.0),
        "end error, re-simulated": ("exported_end_error_m", 1e3),
        "largest force at any instant": ("exported_peak_force_N", 1.0),
        "optimum: final time": ("final_time_s", 1.0),
        "optimum: end error, re-simulated": ("end_error_m", 1e3),
    }
    for label, (name, scale) in names.items():
        found = re.search(rf"^ {re.escape(label)} +([0-9.]+) ", README, re.M)
        assert found, label
        assert float(found[1]) == pytest.approx(scale * values[name], rel=PRINTED), label
    peak = f"{values['peak_force_between_nodes_N']:.0f} N"
    assert f"({peak})" in README


def fences(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", README, re.S | re.M)


def test_every_fence_has_a_language_that_is_tested_here() -> None:
    opened = re.findall(r"^```(.*)$", README, re.M)[::2]
    assert sorted(opened) == ["python"] * 5 + ["sh", "text", "toml"]


def test_commands_of_the_readme_are_targets_of_make() -> None:
    makefile = (CLONE / "Makefile").read_text(encoding="utf-8")
    commands = [line.split("#")[0].split() for line in fences("sh")[0].splitlines()]
    assert len(commands) == 2
    for make, target in commands:
        assert make == "make" and re.search(rf"^{target}:", makefile, re.M)


def test_the_signal_of_the_readme_is_one_of_a_log() -> None:
    (signals,) = map(tomllib.loads, fences("toml"))
    assert {name: MeasuredSignalSection(**given) for name, given in signals.items()}.keys() == {"force_N"}


def test_python_blocks_run_as_printed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    poses = rng.uniform([-0.3, -3.1, 0.2, 0.0], [0.9, -2.1, 0.4, 2.0], (12, 4))
    m, c, k = (size * np.exp(0.1 * rng.standard_normal((12, 3))) for size in (200.0, 4000.0, 3e6))
    field, _ = gt.vibration.fit_oscillator_field(poses, m, c, k, starts=1, calibrate=False)
    Path("oscillators.toml").write_text(gt.vibration.oscillator_text(field), encoding="utf-8")
    scope: dict[str, Any] = {}
    for block in fences("python"):
        exec(block, scope)
    assert scope["status"].name == "OK" and np.all(np.isfinite(scope["T"]))
    assert scope["m"].shape == (3,)
    assert "sphere pencil" in capsys.readouterr().out
