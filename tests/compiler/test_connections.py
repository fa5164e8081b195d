"""Connection sets: equal potentials, flows that sum to zero, and the sign of a port seen from inside."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.causal import flat_of
from tests.support.models import Ground, Pin, Resistor, Source, TwoPins

ROUND_OFF = 1e-13


def values(model: gt.Model, known: Any, names: list[str], *arguments: Any) -> list[float]:
    *found, status = model.causal(known, names)(*arguments)
    assert status == gt.Status.OK
    return found


class Parallel(gt.Model):
    """Two resistors side by side behind two outer pins."""

    p = gt.port(Pin)
    n = gt.port(Pin)
    a = gt.part(Resistor, R=2.0)
    b = gt.part(Resistor, R=3.0)

    def equations(self):
        yield gt.connect(self.p, self.a.p)
        yield gt.connect(self.p, self.b.p)
        yield gt.connect(self.a.n, self.n)
        yield gt.connect(self.b.n, self.n)


class Nested(gt.Model):
    """The parallel pair in series with a resistor, one level further down."""

    p = gt.port(Pin)
    n = gt.port(Pin)
    pair = gt.part(Parallel)
    rest = gt.part(Resistor, R=0.8)

    def equations(self):
        yield gt.connect(self.p, self.pair.p)
        yield gt.connect(self.pair.n, self.rest.p)
        yield gt.connect(self.rest.n, self.n)


def driven(part: type[gt.Model]) -> gt.Model:
    class Driven(gt.Model):
        u = gt.input(unit="V")
        source = gt.part(Source)
        load = gt.part(part)
        ground = gt.part(Ground)

        def equations(self):
            yield self.source.v == self.u
            yield gt.connect(self.source.p, self.load.p)
            yield gt.connect(self.load.n, self.source.n)
            yield gt.connect(self.source.n, self.ground.p)

    return Driven()


class TestHierarchy:
    def test_flows_count_with_the_right_sign(self):
        # 12 V over 2 and 3 Ohm: 6 A and 4 A; flows are positive into the component that owns the port
        names = ["load.a.i", "load.b.i", "load.p.i", "load.n.i", "load.a.p.i", "load.a.n.i", "source.p.i", "ground.p.i"]
        found = values(driven(Parallel), "u", names, 12.0)
        assert np.allclose(found, [6, 4, 10, -10, 6, -6, -10, 0], rtol=ROUND_OFF, atol=ROUND_OFF)

    def test_two_levels(self):
        # 2 and 3 Ohm side by side are 1.2 Ohm, with 0.8 Ohm in series 2 Ohm
        names = ["load.p.i", "load.pair.p.i", "load.pair.n.i", "load.rest.i", "load.pair.n.v", "load.pair.b.i"]
        found = values(driven(Nested), "u", names, 12.0)
        assert np.allclose(found, [6, 6, -6, 6, 4.8, 2.4], rtol=ROUND_OFF)

    def test_what_goes_in_comes_out(self):
        model = driven(Nested)
        flat = flat_of(model)
        names = [n for n in flat.groups if n.startswith("load.") and n.endswith(".i")]
        by_name = dict(zip(names, values(model, "u", names, 12.0), strict=True))
        for component in ("load", "load.pair"):
            assert by_name[f"{component}.p.i"] + by_name[f"{component}.n.i"] == pytest.approx(0, abs=ROUND_OFF)


class TestLonePorts:
    def test_the_flow_of_a_lone_port_is_zero(self):
        class Loose(gt.Model):
            u = gt.input(unit="V")
            source = gt.part(Source)
            loose = gt.part(Resistor, R=5.0)
            ground = gt.part(Ground)

            def equations(self):
                yield self.source.v == self.u
                yield gt.connect(self.source.n, self.ground.p)
                yield gt.connect(self.source.p, self.loose.p)

        found = values(Loose(), "u", ["loose.i", "loose.n.i", "loose.n.v", "source.i"], 12.0)
        assert found == [0.0, 0.0, 12.0, 0.0]

    def test_an_outer_port_of_the_whole_model_too(self):
        class Whole(Parallel):
            ground = gt.part(Ground)

            def equations(self):
                yield from super().equations()
                yield gt.connect(self.n, self.ground.p)

        assert values(Whole(), (), ["a.i", "p.i", "p.v"]) == [0.0, 0.0, 0.0]

    def test_a_lone_port_is_named_in_its_equation(self):
        class Alone(gt.Model):
            r = gt.part(Resistor, R=1.0)

        labels = [e.label for e in flat_of(Alone()).equations]
        assert "flow i of r.p" in labels
        assert "flow i of r.n" in labels


class TestSets:
    def test_order_and_direction_of_connections_do_not_matter(self):
        class Star(gt.Model):
            u = gt.input(unit="V")
            source = gt.part(Source)
            arms = gt.parts(3, Resistor, R=[1.0, 2.0, 4.0])
            ground = gt.part(Ground)

            def equations(self):
                yield self.source.v == self.u
                yield gt.connect(self.source.n, self.ground.p)
                yield gt.connect(self.arms[0].n, self.ground.p)
                yield gt.connect(self.ground.p, self.arms[1].n)
                yield gt.connect(self.arms[2].n, self.arms[1].n)
                yield from self.upper()

            def upper(self):
                yield gt.connect(self.arms[0].p, self.source.p)
                yield gt.connect(self.arms[1].p, self.arms[0].p)
                yield gt.connect(self.arms[2].p, self.arms[0].p)

        class Turned(Star):
            def upper(self):
                yield gt.connect(self.source.p, self.arms[2].p)
                yield gt.connect(self.arms[2].p, self.arms[1].p)
                yield gt.connect(self.arms[1].p, self.arms[0].p)

        for cls in (Star, Turned):
            found = values(cls(), "u", ["arms[0].i", "arms[1].i", "arms[2].i", "source.p.i"], 4.0)
            assert np.allclose(found, [4, 2, 1, -7], rtol=ROUND_OFF)

    def test_a_set_has_one_flow_equation_and_one_potential_less_than_ports(self):
        flat = flat_of(driven(Parallel))
        labels = [e.label for e in flat.equations if e.label.startswith(("flow", "connection"))]
        flows = [x for x in labels if x.startswith("flow")]
        # nine pins; load.p and load.n have an inside and an outside face: eleven faces in four sets
        assert len(flows) == 4
        assert len(labels) - len(flows) == 11 - 4

    def test_arrays_of_ports(self):
        class Plug(gt.Model):
            pins = gt.ports(3, Pin)

            def equations(self):
                for k, pin in enumerate(self.pins):
                    yield pin.v == float(k)

        class Load(gt.Model):
            R = gt.parameter(0.25, unit="Ohm", positive=True)
            pins = gt.ports(3, Pin)

            def equations(self):
                yield self.pins[0].i == 0.5
                yield self.pins[1].i == 2.0
                yield self.R * self.pins[2].i == self.pins[2].v - self.pins[1].v

        class Top(gt.Model):
            plug = gt.part(Plug)
            load = gt.part(Load)

            def equations(self):
                yield gt.connect(self.plug.pins, self.load.pins)

        class Wrong(Top):
            def equations(self):
                yield gt.connect(self.plug.pins, self.load.pins[:2])

        assert values(Top(), (), [f"plug.pins[{k}].i" for k in range(3)]) == [-0.5, -2.0, -4.0]
        with pytest.raises(gt.ModelError, match="two arrays of ports of equal length"):
            Wrong().causal((), "plug.pins[0].i")


class Flange(gt.Connector):
    s = gt.potential(unit="m")
    f = gt.flow(unit="N")


class Mechanical(gt.Model):
    flange = gt.port(Flange)


class TestRefusals:
    def refused(self, body: dict[str, Any], equations: Any) -> str:
        """The sentence, if a place in this file ends it."""
        cls = type("Refused", (gt.Model,), {**body, "equations": equations})
        with pytest.raises(gt.ModelError) as error:
            flat_of(cls())
        sentence, here, _ = str(error.value).partition(" (compiler/test_connections.py:")
        return sentence if here else "no place told"

    def test_different_connectors(self):
        def equations(self):
            yield gt.connect(self.r.p, self.m.flange)

        body = {"r": gt.part(Resistor, R=1.0), "m": gt.part(Mechanical)}
        assert "'r.p' is a Pin and 'm.flange' is a Flange: only ports of the same connector" in self.refused(
            body, equations
        )

    def test_something_that_is_no_port(self):
        def equations(self):
            yield gt.connect(self.r.p, self.r.v)

        assert "connect() takes ports; found Expr" in self.refused({"r": gt.part(Resistor, R=1.0)}, equations)

    def test_a_port_with_itself(self):
        def equations(self):
            yield gt.connect(self.r.p, self.r.p)

        assert "port 'r.p' is connected to itself" in self.refused({"r": gt.part(Resistor, R=1.0)}, equations)

    def test_a_pair_twice(self):
        def equations(self):
            yield gt.connect(self.r.p, self.g.p)
            yield gt.connect(self.g.p, self.r.p)

        body = {"r": gt.part(Resistor, R=1.0), "g": gt.part(Ground)}
        assert "'g.p' and 'r.p' are connected twice" in self.refused(body, equations)

    def test_a_port_of_a_part_of_a_part(self):
        def equations(self):
            yield gt.connect(self.load.a.p, self.g.p)

        body = {"load": gt.part(Parallel), "g": gt.part(Ground)}
        assert "port 'load.a.p' belongs neither to 'Refused' nor to one of its parts" in self.refused(body, equations)

    def test_flow_without_a_connector_of_its_own(self):
        # the law of a component refers to its own ports only; a typing error in a name is told with its line
        class Odd(TwoPins):
            def law(self):
                return self.v == self.q.v

        with pytest.raises(gt.ModelError, match=r"'q'.*test_connections") as caught:
            flat_of(Odd())
        assert isinstance(caught.value.__cause__, AttributeError)
