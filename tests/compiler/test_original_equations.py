"""At the solved point every equation that a person wrote holds, those included that elimination took away."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.alias import eliminate
from gtmodel.compiler.causal import flat_of
from tests.support.models import Bridge, FourBar, Pendulum, SeriesRLC, SliderCrank
from tests.support.residuals import arguments, every_pair, original_residuals
from tests.support.rods import ThreeRods

# SI units, quantities up to some hundred; round-off of sums of such is 1e-13.
HOLDS = 1e-10

PENDULUM = Pendulum()
CRANK = SliderCrank()
FOUR_BAR = FourBar()
RLC = SeriesRLC()
RODS = ThreeRods()
BRIDGE = Bridge()
KNOWN_T = {"T": [1.5, -0.5, 0.8], "der(T)": [0.3, -0.2, 0.5], "der(T,2)": [2.0, 1.0, -3.0]}
KNOWN_Q = {"q": [0.1, -0.2, 0.15], "der(q)": [0.3, -0.2, 0.5], "der(q,2)": [2.0, 1.0, -3.0]}
FORCES = {"tau": [50.0, -20.0, 80.0]}

CASES: dict[str, tuple[gt.Model, dict[str, Any], dict[str, Any]]] = {
    "pendulum in x": (PENDULUM, {"x": 0.6, "der(x)": 0.4}, dict(prefer="x")),
    "pendulum in y": (PENDULUM, {"y": -0.8, "der(y)": 0.4}, dict(prefer="y")),
    "slider-crank by forces, in s": (
        CRANK, {"s": 0.9, "der(s)": 0.3, "torque": 2.0, "force": -7.0}, dict(known=["torque", "force"], prefer="s"),
    ),
    "slider-crank by forces, in x": (
        CRANK, {"P[0]": 0.2, "der(P[0])": 0.3, "torque": 2.0, "force": -7.0},
        dict(known=["torque", "force"], prefer="P[0]"),
    ),
    "slider-crank by the slider": (
        CRANK, {"s": 0.9, "der(s)": 0.3, "der(s,2)": 0.7, "force": -7.0},
        dict(known=["s", "force"], branches={"up": -1}),
    ),
    "slider-crank by the pin": (
        CRANK, {"P[0]": 0.2, "der(P[0])": 0.3, "der(P[0],2)": 0.7, "torque": 2.0},
        dict(known=["P[0]", "torque"], branches={"right": -1}),
    ),
    "four-bar": (FOUR_BAR, {"theta": 0.7}, dict(known="theta")),
    "four-bar crossed": (FOUR_BAR, {"theta": 0.7}, dict(known="theta", branches={"open": -1})),
    "circuit by the source": (
        RLC, {"u": 12.0, "capacitor.v": 3.0, "inductor.i": 0.2}, dict(known="u", prefer=["capacitor.v", "inductor.i"]),
    ),
    "circuit by the capacitor": (
        RLC, {f"der(capacitor.v,{k})": 1.0 + k for k in range(2, 5)} | {"capacitor.v": 3.0, "der(capacitor.v)": 0.2},
        dict(known="capacitor.v"),
    ),
    "bridge": (BRIDGE, {"u": 12.0}, dict(known="u")),
    "bridge by the detector": (BRIDGE, {"resistor[4].i": 1.2}, dict(known="resistor[4].i")),
    "rods by T": (RODS, KNOWN_T, dict(known="T")),
    "rods by T, behind": (RODS, KNOWN_T, dict(known="T", branches={f"ahead[{i}]": -1 for i in range(3)})),
    "rods by q": (RODS, KNOWN_Q, dict(known="q")),
    "rods by forces, in T": (RODS, KNOWN_T | FORCES, dict(known="tau", prefer="T")),
    "rods by forces, in q": (RODS, KNOWN_Q | FORCES, dict(known="tau", prefer="q")),
    "rods by two carts and a force": (
        RODS, KNOWN_Q | FORCES, dict(known=["q[0]", "q[1]", "tau[2]"], prefer="q[2]"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_every_original_equation_holds(name):
    model, values, causality = CASES[name]
    residuals = original_residuals(model, values, **causality)
    assert len(residuals) == len(flat_of(model).equations)
    assert np.max(np.abs(residuals)) < HOLDS


@pytest.mark.parametrize("name", ["rods by T", "bridge", "circuit by the source"])
def test_every_name_can_be_asked_for_alone(name):
    model, values, causality = CASES[name]
    flat = flat_of(model)
    names = [flat.symbol_name(*p) for p in every_pair(flat)]
    removed = eliminate(flat, frozenset()).removed
    assert len(removed) > 10  # the question is not empty
    together = model.causal(causality["known"], names, causality.get("prefer", ()))
    *expected, _ = together(*arguments(together, values))
    gone = [flat.variables[i].name for i in sorted(removed)]
    for asked in gone[:: len(gone) // 4]:  # a few of them: every function is compiled anew
        f = model.causal(causality["known"], asked, causality.get("prefer", ()))
        found, status = f(*arguments(f, values))
        assert status == gt.Status.OK
        assert found == pytest.approx(expected[names.index(asked)], rel=1e-12, abs=1e-12)


def test_the_check_can_fail():
    # a residual of a wrong model is seen: the same numbers in a pendulum of another length
    class Longer(Pendulum):
        def equations(self):
            *dynamics, _ = super().equations()
            yield from dynamics
            yield self.x**2 + self.y**2 == (1.001 * self.L) ** 2

    flat = flat_of(PENDULUM)
    assert len(flat.equations) == 3
    f = Longer().causal((), ["x", "y"], prefer="x")
    x, y, _ = f(0.6)
    assert abs(x**2 + y**2 - 1.0) > 1e-3
