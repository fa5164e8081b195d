"""The same model gives the same function, to the letter, whatever the hash seed of the process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# Everything that could depend on the order of a set or of hashes: generated C, inputs, certificate, states, samples.
PROGRAM = """
import sys
import gtmodel as gt
from tests.support.models import Bridge, SliderCrank
from tests.support.rods import FourRods, ThreeRods

rods = ThreeRods()
cases = [
    rods.causal("T", ["tau", "rod[1].tension"], branches={"ahead[1]": -1}),
    rods.causal("tau", ["der(T,2)", "der(q,2)"], prefer="q"),
    SliderCrank().causal(["torque", "force"], "der(s,2)"),
    Bridge().causal("u", ["resistor[4].i", "source.i"]),
]
for f in cases:
    print(f, f.explain(), f.plan.samples.tolist(), sep="\\n")
for g in [f.casadi for f in cases] + [cases[0].casadi_parametric]:
    g.generate("model.c")
    print(open("model.c").read())
try:
    FourRods().causal("tau", "T")
except gt.ModelError as error:
    print(error)
"""


def run(seed: str, folder: Path) -> str:
    folder.mkdir()
    environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)}
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, cwd=folder, env=environment, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def texts(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("determinism")
    return [run(seed, folder / seed) for seed in ("0", "12345")]


def test_two_processes_with_different_hash_seeds_agree_to_the_letter(texts):
    first, second = texts
    different = [(a, b) for a, b in zip(first.splitlines(), second.splitlines(), strict=True) if a != b]
    assert different == []


def test_the_text_holds_what_it_should(texts):
    assert texts[0].count("casadi_real") > 50
    assert texts[0].count("sqrt") > 3
    assert "sphere pencil" in texts[0]
    assert "19 equations have rank 18" in texts[0]
    assert str(ROOT) not in texts[0]  # the same on every machine: locations are two path parts
