"""Sampled blocks as step functions in C: the bytes of their twin, the numbers of their simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.cgen.real import DOUBLE, GenerationError
from gtmodel.cgen.steps.function import record, step_faces
from gtmodel.cgen.verification.comparison import LoadedStep
from tests.cgen.calls import shared_library


class Law(gt.SampledBlock):
    """A feedback of two places with a filtered derivative and a soft limit."""

    kp = gt.parameter(4.0, unit="1/s")
    ki = gt.parameter(2.0, unit="1/s2")
    most = gt.parameter(0.5, unit="m/s")
    error = gt.input(2, unit="m")
    integral = gt.discrete([0.1, -0.2], unit="m.s")
    speed = gt.output([0.0, 0.0], unit="m/s")
    size = gt.output(unit="m")

    def step(self, inputs, state):
        integral = state.integral + self.period * inputs.error
        wanted = self.kp * inputs.error + self.ki * integral
        size = np.sqrt(inputs.error[0] ** 2 + inputs.error[1] ** 2)
        return {"speed": self.most * np.tanh(wanted / self.most), "integral": integral, "size": size}


class Loop(gt.Model):
    x = gt.variable(2, unit="m", start=[0.0, 0.3], fixed=True)
    law = gt.part(Law, period=0.004)

    def equations(self):
        yield gt.der(self.x) == self.law.speed
        yield self.law.error == -self.x


class Limited(gt.SampledBlock):
    error = gt.input(unit="m")
    speed = gt.output(unit="m/s")

    def step(self, inputs, state):
        return {"speed": 1.0 if inputs.error > 0 else -1.0}


class Switched(gt.Model):
    x = gt.variable(unit="m", start=0.0, fixed=True)
    law = gt.part(Limited, period=0.004)

    def equations(self):
        yield gt.der(self.x) == self.law.speed
        yield self.law.error == -self.x


@pytest.mark.parametrize("real", ["double", "float"])
def test_a_block_in_c_equals_its_twin(real: str, tmp_path: Path) -> None:
    law = {"law": cgen.BlockFunction(Loop(), "law")}
    folder = cgen.generate(law, tmp_path / "c", name="loop", real=real).folder
    report = cgen.check(folder, law, points=300)
    assert report.passed, report.message
    assert report.rows_ok["law"] > 100


def test_a_block_in_c_is_the_one_that_is_simulated(tmp_path: Path) -> None:
    law = cgen.BlockFunction(Loop(), "law")
    folder = cgen.generate({"law": law}, tmp_path / "c", name="loop").folder
    loaded = LoadedStep(shared_library(folder, tmp_path), step_faces({"law": law}, "loop", DOUBLE)[0])
    samples = gt.simulate(Loop(), 0.4).samples["law"]
    start, state = loaded.face.started()
    out = record(law.outputs, DOUBLE)
    assert loaded.init(state, start) == Status.OK
    for error, speed, size in zip(samples["error"], samples["speed"], samples["size"], strict=True):
        assert loaded.step(state, record(law.inputs, DOUBLE, {"error": error}), out) == Status.OK
        assert np.allclose(out["speed_m_s"], speed, rtol=1e-14, atol=1e-15) and np.isclose(out["size_m"], size)


def test_a_step_that_branches_on_a_number_is_refused() -> None:
    with pytest.raises(GenerationError, match="without branches on numbers"):
        cgen.BlockFunction(Switched(), "law")
    with pytest.raises(GenerationError, match="there are 'law'"):
        cgen.BlockFunction(Switched(), "filter")
