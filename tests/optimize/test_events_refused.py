"""Orders of events and optimisations with events that are refused, in words and at their lines."""

from __future__ import annotations

import re

import pytest

import gtmodel as gt
from tests.optimize.test_events import Throw

WRONG = {
    "unknown event": (
        Throw,
        ["event 2"],
        {},
        r"Throw has no event 'event 2'; events are event 1 \(.*test_events.py:\d+\): ",
    ),
    "no event": (Throw, [], {}, r"order must be a non-empty list of event names.*events are event 1"),
    "a number": (Throw, [1], {}, r"order must be a non-empty list of event names.*found \[1\]"),
    "twice at one instant": (Throw, [("event 1", "event 1")], {}, r"event 1 .*named twice at the end of phase 1"),
    "held unknown": (
        Throw,
        ["event 1"],
        {"held": ["bounce"]},
        r"held contains the unknown event 'bounce'; events are event 1",
    ),
    "held one word": (Throw, ["event 1"], {"held": "event 1"}, r"held takes a list of names; found 'event 1'"),
    "held otherwise": (
        Throw,
        ["event 1"],
        {"held": ["event 1"]},
        r"held is inconsistent: .*test_events.*does not hold",
    ),
    "instants": (Throw, ["event 1"], {"instants": [0.4, 0.3]}, r"instants must be 1 increasing times.*\[0.4, 0.3\]"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_order_gets_its_sentence(name: str) -> None:
    model, order, more, sentence = WRONG[name]
    with pytest.raises(gt.ModelError, match=sentence) as caught:
        gt.phases_of_events(model(), order, **more)
    assert "\n" not in str(caught.value)


def test_no_events_no_phases() -> None:
    class Still(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True)

        def equations(self):
            yield gt.der(self.x) == 1.0

        def objective(self):
            return self.x.at(self.final_time)

    with pytest.raises(gt.ModelError, match=r"Still has no events; use gt.solve"):
        gt.phases_of_events(Still(), ["event 1"])
    with pytest.raises(gt.ModelError, match="takes a configured Optimization"):
        gt.phases_of_events(Still, ["event 1"])


class Fall(gt.Optimization):
    x = gt.variable(start=1.0, fixed=True)
    n = gt.discrete(0.0)
    u = gt.input()

    def equations(self):
        yield gt.der(self.x) == self.u
        yield gt.when(self.x <= 0.0, self.n == 1.0)

    def objective(self):
        return gt.integral(self.u**2)


def refusal(**body: object) -> str:
    """The sentence about a fall that is changed so."""
    with pytest.raises(gt.ModelError) as caught:
        gt.phases_of_events(type("Wrong", (Fall,), body)(), ["event 1"])
    return str(caught.value)


def test_what_joins_phases_is_refused() -> None:
    def at(self):
        return self.x.at(0.3)

    def product(self):
        return self.x.at(self.start_time) * self.x.at(self.final_time)

    def squared(self):
        return gt.integral(self.u) ** 2

    def both(self):
        yield self.x.at(self.start_time) == self.x.at(self.final_time)

    def total(self):
        yield gt.integral(self.u) <= 1.0

    def branch(self):
        return gt.integral(gt.If(self.x >= 0.5, self.u, 2 * self.u))

    assert re.search(r"lies between the ends", refusal(objective=at))
    sentence = refusal(objective=product)
    assert re.search(r"multiplies values at the start and at the end.*test_events", sentence)
    assert re.search(r"must be a weighted sum of gt.integral.*test_events", refusal(objective=squared))
    assert re.search(r"contains values at both ends.*test_events", refusal(constraints=both))
    assert re.search(r"contains an integral over the whole.*test_events", refusal(constraints=total))
    assert re.search(r"gt.If is not allowed in objective.*test_events", refusal(objective=branch))


def test_conditions_that_no_order_tells_are_refused() -> None:
    def joined(self):
        yield gt.der(self.x) == self.u
        yield gt.when((self.x <= 0.0) & (self.time >= 0.5), self.n == 1.0)

    def clock(self):
        yield gt.der(self.x) == self.u
        yield gt.when(gt.sample(0.1), self.n == 1.0)

    def impulse(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == self.u + self.f
        yield self.f == 0.0
        yield gt.when(self.x <= 0.0, gt.reinit(self.v, -0.5 * self.v, impulse=self.f), self.n == 1.0)

    assert re.search(r"which vary independently.*test_events", refusal(equations=joined))
    assert re.search(
        r"gt.sample\(\) or gt.initial\(\), which phases do not support.*test_events", refusal(equations=clock)
    )
    assert re.search(
        r"acts by a force impulse.*test_events", refusal(equations=impulse, v=gt.variable(), f=gt.variable())
    )


def test_a_sampled_block_is_refused() -> None:
    class Law(gt.SampledBlock):
        e = gt.input()
        y = gt.output()

        def step(self, inputs, state):
            return {"y": inputs.e}

    def looped(self):
        yield gt.der(self.x) == self.law.y + self.u
        yield self.law.e == -self.x
        yield gt.when(self.x <= 0.0, self.n == 1.0)

    law = gt.part(Law, period=0.1)
    assert re.search(r"a sampled block, which phases do not support.*test_events", refusal(equations=looped, law=law))
    Looped = type("Looped", (Fall,), {"equations": looped, "law": law})
    with pytest.raises(gt.ModelError, match=r"the sampled block 'law', whose steps are not equations.*test_events"):
        gt.solve(Looped())
