"""Tests of outputs that are finite are left out of the C only if limits and margins imply them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.cgen.bounds import surely_finite
from gtmodel.cgen.interface import interfaces


def judged(model: gt.Model, known: str, targets: str) -> bool:
    (face,) = interfaces({"f": model.causal(known=known, targets=targets)}, "b")
    return surely_finite(face)


class Of(gt.Model):
    """y as a function of x."""

    x = gt.variable(unit="1", start=0.5)
    y = gt.variable(unit="1", start=0.5)

    def value(self) -> Any: ...

    def equations(self) -> Any:
        yield self.y == self.value()


class Bounded(Of):
    def value(self) -> Any:
        return gt.sin(self.x) / (2.0 + 0.0 * self.x) + gt.sqrt(self.x**2 + self.x**2) + gt.tanh(self.x**3)


class Divided(Of):
    def value(self) -> Any:
        return 1.0 / gt.sin(self.x)


class Rooted(Of):
    def value(self) -> Any:
        return gt.sqrt(gt.sin(self.x))


class Large(Of):
    def value(self) -> Any:
        return gt.exp(self.x)


class Powers(Of):
    def value(self) -> Any:
        y = self.x
        for _ in range(6):  # x^64: beyond the largest number for the largest x
            y = y * y
        return gt.sin(y)


@pytest.mark.parametrize("model, expected", [(Bounded, True), (Divided, False), (Rooted, False), (Large, False),
                                             (Powers, False)])  # fmt: skip
def test_what_can_be_infinite_or_no_number_is_tested(model: type[Of], expected: bool) -> None:
    assert judged(model(), "x", "y") is expected


def test_the_statuses_of_the_l1_do_not_need_the_test() -> None:
    """At inputs up to their limits no status is NOT_FINITE, and wherever margins pass the outputs are finite."""
    robot = gt.robots.gantry_tau("l1_tape")
    rng = np.random.default_rng(46)
    for known, targets in (("q", "T"), ("T", "q"), ("T", "tau")):
        f = robot.causal(known=known, targets=targets)
        assert judged(robot, known, targets)
        rows = [robot.home * 0 + 10.0 ** rng.uniform(-3, np.log10(limit), (20_000, 1)) * rng.normal(size=(20_000, 3))
                for limit in f.sizes.limits]  # fmt: skip
        values, status = f(*rows)
        assert not np.any(status == gt.Status.NOT_FINITE)
        assert np.isfinite(values[status == gt.Status.OK]).all()
    near = robot.home + rng.normal(size=(20_000, 3))
    values, status = robot.causal("T", "tau")(
        near, 1e15 * rng.normal(size=near.shape), 1e15 * rng.normal(size=near.shape)
    )
    assert (status == gt.Status.OK).sum() > 1000 and np.isfinite(values[status == gt.Status.OK]).all()


def test_a_divisor_without_a_margin_is_tested() -> None:
    """The plate's forward dynamics in cart coordinates divides by what no margin bounds."""
    robot = gt.robots.gantry_tau("l1_tape")
    (face,) = interfaces({"f": robot.causal("tau", "der(q,2)", prefer="q")}, "b")
    assert not surely_finite(face)
