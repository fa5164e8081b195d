"""Expandable connectors: a bus has the variables that are connected to it, here or at another end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt

pytest.importorskip("lark")

PARTS = """
expandable connector Inner end Inner;
expandable connector Bus Inner axis; Real spare "declared, and connected by nobody"; end Bus;
connector Out = output Real; connector In = input Real;
connector Pin Real v; flow Real i; end Pin;
block Sensor Out w(unit = "rad/s"); equation w = sin(time); end Sensor;
block Gain In u; Out y; parameter Real k; equation y = k*u; end Gain;
model Plant Bus bus; Sensor sensor; equation connect(bus.speed, sensor.w); end Plant;
model Controller
  Bus bus; Inner axis; Gain g(k = 2), many[2](k = {3, 4});
equation
  connect(g.u, bus.speed); connect(bus.torque, g.y);
  connect(axis, bus.axis);
  for n in 1:2 loop connect(axis.read, many[n].u); end for;
  if true then connect(axis.high, many[2].y); end if;
end Controller;
model Drive
  Plant plant; Controller controller; Bus bus; Real x(start = 0, fixed = true); Real y; Gain last(k = 1);
equation
  connect(plant.bus, bus); connect(bus, controller.bus);
  connect(bus.torque, last.u);
  connect(controller.axis.read, plant.sensor.w);
  der(x) = last.y; y = controller.axis.high;
end Drive;
"""


def _loaded(tmp_path: Path, text: str) -> gt.Model:
    file = tmp_path / "bus.mo"
    file.write_text(PARTS + text, encoding="utf-8")
    return gt.modelica.load(f"{file}:M")()


def test_a_signal_goes_from_bus_to_bus(tmp_path: Path) -> None:
    s = gt.simulate(_loaded(tmp_path, "model M extends Drive; end M;"), 1.0)
    # x' = 2 sin t; the simulation's default tolerance is 1e-6 of a unit
    assert s.trajectory["x"][-1] == pytest.approx(2 * (1 - np.cos(1.0)), abs=1e-6)
    assert s.trajectory["y"][-1] == pytest.approx(4 * np.sin(1.0), abs=1e-12)
    # the plant reads no torque, and has it all the same: its bus is one with the controller's
    assert s.trajectory["plant.bus.torque"][-1] == pytest.approx(2 * np.sin(1.0), abs=1e-12)
    assert s.trajectory["plant.bus.axis.high"][-1] == pytest.approx(4 * np.sin(1.0), abs=1e-12)
    assert "bus.spare" not in s.trajectory.names


def test_connectors_with_flows_connect_through_a_bus(tmp_path: Path) -> None:
    text = """model Resistor Pin a; parameter Real R = 1; equation a.v = R*a.i; end Resistor;
    model Load Bus bus; Resistor r(R = 2); equation connect(bus.pin, r.a); end Load;
    model Source Pin p; equation p.v = 3; end Source;
    model M Load one, two; Bus bus; Source s; Real x(start = 0, fixed = true);
    equation connect(one.bus, bus); connect(two.bus, bus); connect(s.p, bus.pin); der(x) = -s.p.i; end M;"""
    # two resistors of 2 Ohm side by side take 3 A
    assert gt.simulate(_loaded(tmp_path, text), 1.0).trajectory["x"][-1] == pytest.approx(3.0, abs=1e-6)


@pytest.mark.parametrize(
    ("equations", "said"),
    [
        ("Bus b[2]; Sensor s; equation connect(b[1].w, s.w);", "array of expandable connectors"),
        ("Bus a, b; equation connect(a.w, b.w);", "the type of 'a.w' is unknown"),
        ("Bus a; Pin p; equation connect(a, p);", "'a' is an expandable connector and 'p' is not"),
        ("Bus a; Sensor s; equation connect(a.w[2], s.w);", "a part is connected; declare 'w' in Bus"),
        ("Bus a; Pin p; Sensor s; equation connect(a.w, p); connect(a.w, s.w);", "connect() needs"),
    ],
)
def test_invalid_connections_of_a_bus_name_the_line(tmp_path: Path, equations: str, said: str) -> None:
    with pytest.raises(gt.ModelError) as error:
        _loaded(tmp_path, f"model M\n{equations} end M;")
    assert said in str(error.value) and "bus.mo:26" in str(error.value)
