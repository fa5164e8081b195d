"""An algebraic output that is another name of a state in one mode, and of another one in the next: it jumps, states go
on. Against closed forms, and scipy with events."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gtmodel as gt

# of runs at 1e-9
TOLERANCE = 1e-8


class Two(gt.Model):
    """a = t, b = 3 exp(-t); y is what a subclass says, from 1 s on something else."""

    a = gt.variable(start=0.0, fixed=True)
    b = gt.variable(start=3.0, fixed=True)
    y = gt.variable()

    def output(self) -> Iterator[Any]:
        yield self.y == gt.If(self.a > 1, self.b, self.a)

    def equations(self):
        yield gt.der(self.a) == 1.0
        yield gt.der(self.b) == -self.b
        yield from self.output()


def b_of(t: np.ndarray) -> np.ndarray:
    return 3 * np.exp(-t)


def saying(output: Callable[[Any], Any], **more: Any) -> gt.Model:
    return type("Said", (Two,), {"output": lambda self: output(self), "__module__": __name__, **more})()


def sides(run: Any, at: float = 1.0) -> np.ndarray:
    """Of each row, whether it comes after the event at that instant."""
    (event,) = [e for e in run.events if abs(e.time - at) < TOLERANCE]
    return run.trajectory.time > event.time


OUTPUTS: dict[str, tuple[Callable[[Any], Any], Callable[[np.ndarray], Any], Callable[[np.ndarray], Any]]] = {
    "one and the other": (lambda m: [m.y == gt.If(m.a > 1, m.b, m.a)], lambda t: t, b_of),
    "the other way round": (lambda m: [m.y == gt.If(m.a > 1, m.a, m.b)], b_of, lambda t: t),
    "a state, then its opposite": (lambda m: [m.y == gt.If(m.a > 1, -m.b, m.b)], b_of, lambda t: -b_of(t)),
    "two opposites": (lambda m: [m.y == gt.If(m.a > 1, -m.b, -m.a)], lambda t: -t, lambda t: -b_of(t)),
    "a state, then a multiple": (lambda m: [m.y == gt.If(m.a > 1, 2 * m.b, m.a)], lambda t: t, lambda t: 2 * b_of(t)),
    "a multiple, then a state": (lambda m: [m.y == gt.If(m.a > 1, m.b, 2 * m.a)], lambda t: 2 * t, b_of),
    "a state, then a number": (lambda m: [m.y == gt.If(m.a > 1, 4.0, m.a)], lambda t: t, lambda t: 4.0 + 0 * t),
    "a state, then a rate": (lambda m: [m.y == gt.If(m.a > 1, gt.der(m.b), m.a)], lambda t: t, lambda t: -b_of(t)),
    "two equations": (lambda m: [gt.If(m.a > 1, m.y == m.b, m.y == m.a)], lambda t: t, b_of),
}


@pytest.mark.parametrize("case", OUTPUTS)
def test_an_output_jumps_and_states_go_on(case: str) -> None:
    output, early, late = OUTPUTS[case]
    run = gt.simulate(saying(output), 2.0, step=0.25)
    t, late_rows = run.trajectory.time, sides(run)
    assert run.status.ok and not run.events[0].restarted
    np.testing.assert_allclose(run.trajectory["y"], np.where(late_rows, late(t), early(t)), atol=TOLERANCE)
    np.testing.assert_allclose(run.trajectory["a"], t, atol=TOLERANCE)
    np.testing.assert_allclose(run.trajectory["b"], b_of(t), atol=TOLERANCE)


def test_what_follows_from_it_follows_and_outputs_may_change_places() -> None:
    class Crossed(Two):
        w, z = gt.variable(), gt.variable(start=0.0, fixed=True)

        def output(self):
            yield self.y == gt.If(self.a > 1, self.b, self.a)
            yield self.w == gt.If(self.a > 1, self.a, self.b)
            yield gt.der(self.z) == self.y - 2 * self.w

    run = gt.simulate(Crossed(), 2.0, step=0.25)
    t, late = run.trajectory.time, sides(run)
    np.testing.assert_allclose(run.trajectory["w"], np.where(late, t, b_of(t)), atol=TOLERANCE)
    early_z = t**2 / 2 - 2 * (3 - b_of(t))
    at_one = 0.5 - 2 * (3 - b_of(np.ones(())))
    late_z = at_one + b_of(np.ones(())) - b_of(t) - (t**2 - 1)
    np.testing.assert_allclose(run.trajectory["z"], np.where(late, late_z, early_z), atol=TOLERANCE)


def test_each_entry_of_an_array_jumps() -> None:
    class Several(gt.Model):
        a = gt.variable(3, start=[0.0, 0.25, 0.5], fixed=True)
        b = gt.variable(3, start=[3.0, 2.0, 1.0], fixed=True)
        y = gt.variable(3)

        def equations(self):
            yield gt.der(self.a) == np.ones(3)
            yield gt.der(self.b) == -self.b
            yield self.y == gt.If(self.a[0] > 1, -self.b, self.a)

    run = gt.simulate(Several(), 2.0, step=0.25)
    t, late = run.trajectory.time[:, None], sides(run)[:, None]
    exact = np.where(late, -np.array([3.0, 2.0, 1.0]) * np.exp(-t), t + np.array([0.0, 0.25, 0.5]))
    np.testing.assert_allclose(run.trajectory["y"], exact, atol=TOLERANCE)


class Selector(gt.Model):
    u, v, y = gt.variable(), gt.variable(), gt.variable()

    def equations(self):
        yield self.y == gt.If(self.u > 1, self.v, self.u)


class Pin(gt.Connector):
    level = gt.potential()


class SelectorOfPins(gt.Model):
    u, v, y = gt.port(Pin), gt.port(Pin), gt.port(Pin)

    def equations(self):
        yield self.y.level == gt.If(self.u.level > 1, self.v.level, self.u.level)


def test_the_output_of_a_component_and_of_its_connector() -> None:
    class WithPart(Two):
        part, pins, out = gt.part(Selector), gt.part(SelectorOfPins), gt.port(Pin)

        def output(self):
            yield self.part.u == self.a
            yield self.part.v == self.b
            yield self.part.y == self.y
            yield self.pins.u.level == self.b
            yield self.pins.v.level == -self.a
            yield gt.connect(self.pins.y, self.out)

    run = gt.simulate(WithPart(), 2.0, step=0.25, outputs=["out.level"])
    t = run.trajectory.time
    np.testing.assert_allclose(run.trajectory["y"], np.where(sides(run), b_of(t), t), atol=TOLERANCE)
    # b falls below 1 at log(3)
    falls = sides(run, np.log(3))
    np.testing.assert_allclose(run.trajectory["out.level"], np.where(falls, b_of(t), -t), atol=TOLERANCE)


@pytest.mark.parametrize(("name", "to"), [("a", 1.5), ("b", 5.0)])
def test_a_state_that_starts_anew_at_the_same_instant(name: str, to: float) -> None:
    def output(m: Any) -> Any:
        yield m.y == gt.If(m.a > 1, -m.b, m.a)
        yield gt.when(m.a > 1, gt.reinit(getattr(m, name), to))

    run = gt.simulate(saying(output), 2.0, step=0.25)
    t, late = run.trajectory.time, sides(run)
    (event,) = run.events
    assert list(event.restarted) == [name] and event.restarted[name][1] == to
    a = np.where(late, (to if name == "a" else 1.0) + t - 1, t)
    b = np.where(late & (name == "b"), to * np.exp(1 - t), b_of(t))
    np.testing.assert_allclose(run.trajectory["a"], a, atol=TOLERANCE)
    np.testing.assert_allclose(run.trajectory["b"], b, atol=TOLERANCE)
    np.testing.assert_allclose(run.trajectory["y"], np.where(late, -b, a), atol=TOLERANCE)


def test_several_switches_at_one_instant_as_scipy_has_them() -> None:
    """Two outputs that drive two states switch at a = 1, where one of these starts anew; one has switched before."""

    class Several(Two):
        w = gt.variable()
        c = gt.variable(start=0.5, fixed=True)
        d = gt.variable(start=0.0, fixed=True)

        def output(self):
            yield self.y == gt.If(self.a > 1, self.b, gt.If(self.c > 0.75, self.d, self.a))
            yield self.w == gt.If(self.a > 1, -self.c, self.d)
            yield gt.der(self.c) == self.y
            yield gt.der(self.d) == self.w + 1
            yield gt.when(self.a > 1, gt.reinit(self.d, -self.d))

    def rate(t: float, x: np.ndarray, mode: int) -> np.ndarray:
        a, b, c, d = x
        return np.array([1.0, -b, (a, d, b)[mode], (-c if mode == 2 else d) + 1])

    def grown(t: float, x: np.ndarray, mode: int) -> float:
        return x[2] - 0.75

    grown.terminal = True  # type: ignore[attr-defined]
    exact = {"rtol": 1e-11, "atol": 1e-12}
    first = solve_ivp(rate, (0.0, 1.0), [0.0, 3.0, 0.5, 0.0], args=(0,), events=grown, **exact)
    second = solve_ivp(rate, (first.t[-1], 1.0), first.y[:, -1], args=(1,), **exact)
    a, b, c, d = second.y[:, -1]
    third = solve_ivp(rate, (1.0, 2.0), [a, b, c, -d], args=(2,), **exact)

    run = gt.simulate(Several(), 2.0, step=0.25)
    assert [e.time for e in run.events] == pytest.approx([first.t[-1], 1.0], abs=TOLERANCE)
    np.testing.assert_allclose([run.trajectory[n][-1] for n in "abcd"], third.y[:, -1], atol=TOLERANCE)


def test_a_state_still_does_not_jump_by_itself() -> None:
    def rate_is_asked(m: Any) -> Any:
        yield m.y == gt.If(m.a > 1, m.b, m.a)
        yield m.w == gt.der(m.y)

    # der(y) makes y a state
    with pytest.raises(gt.ModelError, match=r"at 1 s .*y.*: a state does not jump by itself"):
        gt.simulate(saying(rate_is_asked, w=gt.variable()), 2.0)


def test_a_state_that_an_equation_moves_is_refused_whatever_its_other_names() -> None:
    class Moved(gt.Model):
        a = gt.variable(start=0.0, fixed=True)
        b = gt.variable(start=3.0, fixed=True)
        y, z = gt.variable(), gt.variable()

        def equations(self):
            yield gt.der(self.a) == 1.0
            yield gt.If(self.a > 1, self.b == 7.0, gt.der(self.b) == -self.b)
            yield self.y == gt.If(self.a > 1, self.a, self.b)
            yield self.z == gt.If(self.a > 1, self.b, -self.b)

    with pytest.raises(
        gt.ModelError, match=r"at 1 s .* require b = 7, but it is 1\.1\d*: a state does not jump by itself"
    ):
        gt.simulate(Moved(), 2.0)


def test_a_root_goes_on_beside_its_old_value_where_its_coefficient_jumps() -> None:
    """a y^2 + 0.01 y = a x has two solutions; the slope 2 a y + 0.01 changes its sign with a, and y does not."""

    class Jump(gt.Model):
        c = gt.variable(start=0.0, fixed=True)
        x = gt.variable(start=1.0, fixed=True)
        a = gt.variable(start=1.0)
        y = gt.variable(start=1.0)

        def equations(self):
            yield gt.der(self.c) == 1.0
            yield gt.der(self.x) == 0.1
            yield self.a == gt.If(self.c < 0.5, 1.0 + 0.1 * self.x, -1.0 - 0.1 * self.x)
            yield self.a * self.y * self.y + 0.01 * self.y == self.a * self.x

    trajectory = gt.simulate(Jump(), 1.0).trajectory
    a, x = trajectory["a"], trajectory["x"]
    exact = -0.005 / a + np.sqrt((0.005 / a) ** 2 + x)  # the positive solution, on both sides of the event
    np.testing.assert_allclose(trajectory["y"], exact, rtol=TOLERANCE)


class OverAJump(gt.Model):
    """What is compared jumps over its threshold and has no rate there."""

    x = gt.variable(start=0.0, fixed=True)
    y = gt.variable(start=0.0, fixed=True)

    def equations(self):
        yield gt.der(self.x) == 1.0
        yield gt.der(self.y) == gt.If(gt.piecewise(self.x, [0.0, 0.5, 2.0], [[1.0, 2.0]]) > 1.5, 1.0, 0.0)


def test_a_comparison_that_jumps_over_its_threshold_stays_there():
    s = gt.simulate(OverAJump(), 2.0)
    assert s.trajectory["y"][-1] == pytest.approx(1.5, abs=1e-9)
    assert [round(e.time, 9) for e in s.events] == [0.5]
