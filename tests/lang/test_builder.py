"""The builder layer: the same flat system as a class, line by line."""

import numpy as np
import pytest

import gtmodel as gt

# the same operations in another order
ROUND_OFF = 1e-13


def oscillator() -> gt.Builder:
    m = gt.Builder("oscillator")
    k = m.parameter("k", 100.0, unit="N/m", positive=True)
    mass = m.parameter("m", 4.0, unit="kg", positive=True)
    x = m.variable("x", unit="m", start=1.0)
    m.add(mass * gt.der(x, 2) == -k * x)
    return m


class Oscillator(gt.Model):
    k = gt.parameter(100.0, unit="N/m", positive=True)
    m = gt.parameter(4.0, unit="kg", positive=True)
    x = gt.variable(unit="m", start=1.0)

    def equations(self):
        yield self.m * gt.der(self.x, 2) == -self.k * self.x


def test_builder_equals_class_and_formula() -> None:
    built = oscillator().causal(targets="der(x,2)", prefer="x")
    written = Oscillator().causal(targets="der(x,2)", prefer="x")
    for x in (-2.0, 0.3, 5.0):
        assert built(x)[0] == written(x)[0] == pytest.approx(-25.0 * x, rel=ROUND_OFF)


def test_builder_simulates() -> None:
    run = oscillator().simulate(1.0, start={"x": 1.0, "der(x)": 0.0}, tolerance=1e-11)
    assert run.trajectory["x"] == pytest.approx(np.cos(5.0 * run.trajectory.time), abs=1e-7)


def test_parts_are_usable_at_once_and_later_lines_count() -> None:
    m = gt.Builder("hanging")
    anchor = m.part("anchor", gt.mechanics.Anchor(r=[0.0, 0.0, 2.0]))
    rod = m.part("rod", gt.mechanics.MidpointRod(L=1.0))
    bob = m.part("bob", gt.mechanics.PointMass(m=3.0))
    m.add(gt.connect(anchor.point, rod.a), gt.connect(rod.b, bob.frame))
    m.add(gt.branch("below", rod.a.r[2] - rod.b.r[2]))
    f = m.causal(targets="rod.tension", prefer=["rod.b.r[0]", "rod.b.r[1]"])
    values = [np.zeros(s.shape) for s in f.inputs]
    tension, status = f(*values)  # hanging still: tension times length is the weight
    assert status == gt.Status.OK
    assert tension == pytest.approx(3.0 * 9.81, rel=ROUND_OFF)
    m.add(m.variable("height", unit="m") == bob.frame.r[2])
    assert "height" in m.names()
    assert m.causal(targets="height", prefer=["rod.b.r[0]", "rod.b.r[1]"])(*values[:2])[-1] == gt.Status.OK


def test_a_name_is_declared_once_and_is_a_name() -> None:
    m = oscillator()
    with pytest.raises(gt.ModelError, match="'x' is declared twice in oscillator"):
        m.variable("x", unit="m")
    with pytest.raises(gt.ModelError, match="'2x' is not a valid name"):
        m.variable("2x")
    with pytest.raises(gt.ModelError, match="takes a model such as"):
        m.part("p", gt.mechanics.PointMass)


class Pin(gt.Connector):
    v = gt.potential(unit="V")
    i = gt.flow(unit="A")


class Plug(gt.Connector):
    p = gt.port(Pin)
    n = gt.port(Pin)


class Wire(gt.Model):
    R = gt.parameter(1.0, unit="Ohm")
    a = gt.port(Plug)
    b = gt.port(Plug)

    def equations(self):
        yield self.a.p.v - self.b.p.v == self.R * self.a.p.i
        yield self.a.p.i + self.b.p.i == 0
        yield self.a.n.v == self.b.n.v
        yield self.a.n.i + self.b.n.i == 0


class Source(gt.Model):
    U = gt.input(unit="V")
    plug = gt.port(Plug)

    def equations(self):
        yield self.plug.p.v - self.plug.n.v == self.U
        yield self.plug.n.v == 0


class Load(gt.Model):
    R = gt.parameter(3.0, unit="Ohm")
    plug = gt.port(Plug)

    def equations(self):
        yield self.plug.p.v - self.plug.n.v == self.R * self.plug.p.i
        yield self.plug.p.i + self.plug.n.i == 0


class Circuit(gt.Model):
    source = gt.part(Source)
    wire = gt.part(Wire)
    load = gt.part(Load)

    def equations(self):
        yield gt.connect(self.source.plug, self.wire.a)
        yield gt.connect(self.wire.b, self.load.plug)


def test_ports_inside_ports_are_connected_pairwise() -> None:
    current, back, status = Circuit().causal("source.U", ["load.plug.p.i", "source.plug.n.i"])(8.0)
    assert status == gt.Status.OK
    assert current == pytest.approx(2.0, rel=ROUND_OFF)
    assert back == pytest.approx(2.0, rel=ROUND_OFF)  # it comes back through the other pin
