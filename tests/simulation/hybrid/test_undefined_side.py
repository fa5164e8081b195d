"""Switches between sides of which each is defined on its own side alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy

import gtmodel as gt

END = 2.9
# sin(3 t - 3) rises through 0 at 1 s, and falls through it a half period later
EDGES = [1.0, 1.0 + np.pi / 3]
LAWS: dict[str, tuple[Callable[[Any], Any], Callable[[float], float]]] = {
    "root": (gt.sqrt, np.sqrt),
    "power": (lambda u: u**1.5, lambda u: u**1.5),
    "logarithm": (gt.log, np.log),
    "entropy": (lambda u: u * gt.log(u), lambda u: u * np.log(u)),
    "quotient": (lambda u: (1.0 - gt.cos(u)) / u, lambda u: (1.0 - np.cos(u)) / u),
    "root of a quotient": (lambda u: gt.sqrt(u) / (1.0 - u / 2.0), lambda u: np.sqrt(u) / (1.0 - u / 2.0)),
}


def _switched(law: Callable[[Any], Any]) -> gt.Model:
    class Switched(gt.Model):
        w = gt.parameter(3.0, unit="rad/s")
        x = gt.variable(start=0.0, fixed=True)

        def equations(self):
            u = gt.sin(self.w * self.time - 3.0)
            yield gt.der(self.x) == gt.If(u > 0, law(u), 0.0)

    return Switched()


@cache
def _exact(law: str) -> float:
    """By quadrature over the angle, whose root at both ends is taken out of it."""
    value = LAWS[law][1]

    def over(s: float) -> float:
        # angle = pi sin(s)^2 leaves the ends with a double zero
        return value(np.sin(np.pi * np.sin(s) ** 2)) * 2.0 * np.pi * np.sin(s) * np.cos(s) / 3.0

    return float(scipy.integrate.quad(over, 1e-9, np.pi / 2 - 1e-9, epsabs=1e-12, epsrel=1e-12, limit=200)[0])


@pytest.mark.parametrize("tolerance", [1e-5, 1e-9])
@pytest.mark.parametrize("law", [pytest.param(n, marks=[pytest.mark.proof] if n == "logarithm" else []) for n in LAWS])
def test_a_side_begins_and_ends_at_its_edges(law: str, tolerance: float) -> None:
    run = gt.simulate(_switched(LAWS[law][0]), END, tolerance=tolerance)
    assert [e.time for e in run.events] == pytest.approx(EDGES, abs=1e-13)
    # each of some dozen steps may err by the tolerance
    assert run.trajectory["x"][-1] == pytest.approx(_exact(law), abs=30 * tolerance)


def test_a_text_starts_at_an_edge_and_falls_off_it(tmp_path: Path) -> None:
    law = "if sin(3*time) > 0 then sqrt(sin(3*time)) else 0"
    text = f"model M Real x(start=0, fixed=true); equation der(x) = {law}; end M;"
    (tmp_path / "m.mo").write_text(text, encoding="utf-8")
    run = gt.simulate(gt.modelica.load(f"{tmp_path / 'm.mo'}:M")(), 2.0)
    assert run.trajectory["x"][-1] == pytest.approx(_exact("root"), abs=1e-6)
    assert [e.time for e in run.events if e.time > 0] == pytest.approx([np.pi / 3], abs=1e-13)


class OfState(gt.Model):
    """A root of what is left, which ends where x reaches 1."""

    x = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield gt.der(self.x) == gt.If(self.x < 1.0, gt.sqrt(1.0 - self.x) + 0.1, 1.0)


def test_a_side_of_a_state_ends_at_its_edge() -> None:
    run = gt.simulate(OfState(), 4.0, tolerance=1e-9)
    # s = sqrt(1 - x): dt = -2 s ds/(s + 0.1)
    until = 2.0 * (1.0 - 0.1 * np.log(11.0))
    assert [e.time for e in run.events] == pytest.approx([until], abs=1e-7)
    assert run.trajectory["x"][-1] == pytest.approx(5.0 - until, abs=1e-7)
