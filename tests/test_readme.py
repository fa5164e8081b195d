"""The README is true: its demo table is what the problem gives, its Python runs as printed."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

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


def test_python_blocks_run_as_printed(capsys: pytest.CaptureFixture[str]) -> None:
    scope: dict[str, Any] = {}
    blocks = re.findall(r"```python\n(.*?)```", README, re.S)
    assert len(blocks) == 4
    for block in blocks:
        exec(block, scope)
    assert scope["status"].name == "OK" and np.all(np.isfinite(scope["T"]))
    assert "sphere pencil" in capsys.readouterr().out
