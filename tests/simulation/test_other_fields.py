"""Not only mechanics: circuits in closed form, a drive train with a gear."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError
from gtmodel.simulation import simulate
from tests.simulation.models import DriveTrain
from tests.support.models import Capacitor, Ground, Inductor, Resistor, SeriesRLC, Source

TOLERANCE = 1e-11
INTEGRATOR = 1e-8
R, L, C = 2.0, 0.5, 0.1


def test_series_circuit_against_its_step_response():
    run = simulate(SeriesRLC(), 3.0, inputs={"u": 5.0}, tolerance=TOLERANCE)
    t = run.trajectory.time
    decay, ring = R / (2 * L), np.sqrt(1 / (L * C) - (R / (2 * L)) ** 2)
    v = 5.0 * (1 - np.exp(-decay * t) * (np.cos(ring * t) + decay / ring * np.sin(ring * t)))
    i = 5.0 / (ring * L) * np.exp(-decay * t) * np.sin(ring * t)
    assert run.trajectory["capacitor.v"] == pytest.approx(v, abs=INTEGRATOR)
    assert run.trajectory["inductor.i"] == pytest.approx(i, abs=INTEGRATOR)
    assert run.trajectory["source.i"] == pytest.approx(-i, abs=INTEGRATOR)
    assert run.trajectory.unit("capacitor.v") == "V"


def test_driven_at_resonance_the_current_follows_the_voltage():
    w = 1 / np.sqrt(L * C)
    run = simulate(SeriesRLC(), 12.0, inputs={"u": lambda t: np.sin(w * t)}, tolerance=TOLERANCE)
    late = run.trajectory.time > 10.0
    assert run.trajectory["resistor.i"][late] == pytest.approx(run.trajectory["u"][late] / R, abs=1e-6)


class Loop(gt.Model):
    """Two capacitors in parallel behind a resistor: one state only, and index 2."""

    u = gt.input(unit="V")
    source = gt.part(Source)
    resistor = gt.part(Resistor, R=3.0)
    capacitor = gt.parts(2, Capacitor, C=[0.1, 0.3])
    ground = gt.part(Ground)

    def equations(self):
        yield self.source.v == self.u
        yield gt.connect(self.source.p, self.resistor.p)
        for c in self.capacitor:
            yield gt.connect(self.resistor.n, c.p)
            yield gt.connect(c.n, self.ground.p)
        yield gt.connect(self.source.n, self.ground.p)


def test_capacitors_in_parallel_share_a_state():
    run = simulate(Loop(), 2.0, inputs={"u": 1.0}, tolerance=TOLERANCE, outputs=["capacitor[1].i"])
    assert len(run.states) == 1
    t = run.trajectory
    assert t["capacitor[0].v"] == pytest.approx(1 - np.exp(-t.time / 1.2), abs=INTEGRATOR)
    assert t["capacitor[1].i"] == pytest.approx(0.3 / 0.4 * np.exp(-t.time / 1.2) / 3.0, abs=INTEGRATOR)


def test_inductors_in_series_share_one_too():
    class Chain(gt.Model):
        u = gt.input(unit="V")
        source = gt.part(Source)
        inductor = gt.parts(2, Inductor, L=[0.2, 0.3])
        ground = gt.part(Ground)

        def equations(self):
            yield self.source.v == self.u
            yield gt.connect(self.source.p, self.inductor[0].p)
            yield gt.connect(self.inductor[0].n, self.inductor[1].p)
            yield gt.connect(self.inductor[1].n, self.source.n)
            yield gt.connect(self.source.n, self.ground.p)

    run = simulate(Chain(), 1.0, inputs={"u": lambda t: t}, tolerance=TOLERANCE)
    assert run.trajectory["inductor[1].i"] == pytest.approx(run.trajectory.time**2 / 2 / 0.5, abs=INTEGRATOR)
    assert run.trajectory["inductor[0].v"] == pytest.approx(0.4 * run.trajectory.time, abs=INTEGRATOR)


def test_drive_train_with_a_gear():
    """A constant torque: the whole turns evenly faster, and the shaft swings about its twist."""
    train = DriveTrain()
    run = simulate(train, 0.5, inputs={"torque": 0.4}, tolerance=TOLERANCE, outputs="motor.shaft.phi")
    t = run.trajectory
    J1, J2, k, n = 1e-3 * 50.0**2, 5.0, 4e3, 50.0
    push, w = 0.4 * n, np.sqrt(k * (1 / J1 + 1 / J2))
    # centre of both inertias, and the twist between them
    centre = push / (J1 + J2) * t.time**2 / 2
    twist = push / J1 / w**2 * (1 - np.cos(w * t.time))
    assert t["phi"] == pytest.approx(centre - J1 / (J1 + J2) * twist, abs=INTEGRATOR)
    assert t["motor.shaft.phi"] / n == pytest.approx(centre + J2 / (J1 + J2) * twist, abs=INTEGRATOR)
    supplied = t["energy.supplied"][-1]
    assert supplied == pytest.approx(0.4 * t["motor.shaft.phi"][-1], rel=1e-9)
    assert run.energy_error is not None and run.energy_error < 1e-8 * supplied


class Shorted(gt.Model):
    """A battery whose pins are connected: 0 V and 5 V."""

    V = gt.parameter(5.0, unit="V")
    battery = gt.part(Source)
    ground = gt.part(Ground)

    def equations(self):
        yield gt.connect(self.battery.p, self.battery.n)
        yield gt.connect(self.battery.n, self.ground.p)
        yield self.battery.p.v - self.battery.n.v == self.V


def test_a_contradiction_is_not_called_a_repetition():
    line = Shorted.equations.__code__.co_firstlineno + 3
    with pytest.raises(ModelError, match=rf"'Shorted equation 1' contradicts .* require -5 == 0; .*\.py:{line}\)"):
        simulate(Shorted(), 1.0)
    with pytest.raises(ModelError, match="'Shorted equation 1' is redundant"):
        simulate(Shorted(V=0.0), 1.0)


class Floating(gt.Model):
    """A source and resistors, without a ground."""

    u = gt.input(unit="V")
    source = gt.part(Source)
    resistor = gt.part(Resistor, R=2.0)

    def equations(self):
        yield self.source.v == self.u
        yield gt.connect(self.source.p, self.resistor.p)
        yield gt.connect(self.source.n, self.resistor.n)


class FloatingCapacitor(Floating):
    capacitor = gt.part(Capacitor, C=0.1)
    other = gt.part(Resistor, R=1.0)

    def equations(self):
        yield self.source.v == self.u
        yield gt.connect(self.source.p, self.resistor.p)
        yield gt.connect(self.resistor.n, self.capacitor.p)
        yield gt.connect(self.resistor.n, self.other.p)
        yield gt.connect(self.source.n, self.capacitor.n)
        yield gt.connect(self.source.n, self.other.n)


@pytest.mark.parametrize(
    ("model", "sentence"),
    [
        (Floating, "follows from the other connections: .* have no reference; connect a ground"),
        (FloatingCapacitor, r"flow i of .*; connect a reference, such as a ground, to these ports$"),
    ],
)
def test_a_circuit_without_a_ground(model, sentence):
    with pytest.raises(ModelError, match=sentence):
        simulate(model(), 1.0, inputs={"u": 1.0})
