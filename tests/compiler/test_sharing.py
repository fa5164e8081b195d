"""Equal configurations share what was compiled; whatever may differ does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.compiler.causal import flat_of
from gtmodel.compiler.flat_cache import KEPT, shared


class Law(gt.Model):
    c = gt.parameter(2.0)
    F = gt.variable()
    v = gt.variable()

    def equations(self):
        yield self.F == -self.c * self.v


class Cubic(Law):
    def equations(self):
        yield self.F == -self.c * self.v**3


class Mass(gt.Model):
    m = gt.parameter(1.0)
    at = gt.parameter([0.0, 0.0, 1.0], shape=(3,))
    x = gt.variable(start=0.0)
    law = gt.part(Law)

    def equations(self):
        yield self.law.v == der(self.x)
        yield self.m * der(self.x, 2) == self.law.F + self.at[0]


DIFFERENT: list[dict[str, Any]] = [
    {},
    {"m": 2.0},
    {"m": np.nextafter(1.0, 2.0)},
    {"at": [0.0, 0.0, 1.0]},
    {"at": [-0.0, 0.0, 1.0]},
    {"at": np.array([0.0, 0.0, 1.0])},
    {"law": Cubic},
    {"law": Cubic(c=3.0)},
    {"law": {"c": 3.0}},
    {"x": {"start": 1.0}},
]


def test_equal_configurations_share_a_flat_model():
    for modifiers in DIFFERENT:
        assert flat_of(Mass(**modifiers)) is flat_of(Mass(**modifiers))
    assert gt.robots.gantry_tau("l1_tape").causal("q", "T") is gt.robots.gantry_tau("l1_tape").causal("q", "T")


def test_different_ones_do_not():
    flats = [flat_of(Mass(**modifiers)) for modifiers in DIFFERENT]
    assert len({id(flat) for flat in flats}) == len(DIFFERENT)


def test_a_class_of_the_same_name_is_another_one():
    def own(factor: float) -> type[gt.Model]:
        class Own(gt.Model):
            x = gt.variable()
            u = gt.variable()

            def equations(self):
                yield self.x == factor * self.u

        return Own

    first, second = (own(factor)().causal("u", "x")(1.0)[0] for factor in (2.0, 3.0))
    assert (first, second) == (2.0, 3.0)


def test_functions_have_no_content_and_are_not_shared():
    def made() -> gt.Model:
        return Mass(law={"c": lambda self: self.m})

    assert flat_of(made()) is not flat_of(made())
    model = made()
    assert flat_of(model) is flat_of(model)


def test_a_builder_that_grows_and_an_optimisation_stay_alone():
    class Go(gt.Optimization):
        x = gt.variable()
        u = gt.input()

        def equations(self):
            yield der(self.x) == self.u

        def objective(self):
            return gt.integral(self.u**2)

    assert flat_of(Go()) is not flat_of(Go())


def test_what_was_compiled_before_changes_nothing():
    def text(model: gt.Model) -> str:
        f = model.causal((), ["der(x,2)", "law.F"], prefer="x")
        return f.casadi.serialize() + f.explain()

    shared.cache_clear()
    alone = text(Mass(law=Cubic))
    shared.cache_clear()
    other = Mass(law=Cubic)
    other.causal((), "law.F", prefer="law.v")
    assert text(Mass(law=Cubic)) == alone


def test_only_the_last_few_are_kept():
    first = flat_of(Mass(m=100.0))
    for n in range(KEPT):
        flat_of(Mass(m=101.0 + n))
    assert shared.cache_info().currsize <= KEPT
    assert flat_of(Mass(m=100.0)) is not first


@pytest.mark.parametrize("wrong", [{"m": float("nan")}, {"law": 3.0}])
def test_what_is_wrong_is_refused_every_time(wrong: dict[str, Any]):
    for _ in range(2):
        with pytest.raises(gt.ModelError):
            flat_of(Mass(**wrong))
