"""How a run ends: statuses with sentences, models that are refused, silence on the terminal, equal bytes."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

import gtmodel as gt
from gtmodel import ModelError, NotSimulated, SolveStatus, der
from gtmodel.simulation import simulate
from tests.simulation.models import SwingingPendulum
from tests.simulation.robot import T0, l1
from tests.support.models import Pendulum


class Growing(gt.Model):
    """x' = x^2 from 1: infinite at 1 s."""

    x = gt.variable(unit="1", start=1.0, fixed=True)
    tau = gt.parameter(1.0, unit="s")

    def equations(self):
        yield self.tau * der(self.x) == self.x**2


class Draining(Growing):
    """x' = -1 - sqrt(x): no square root below zero, reached after 2 - 2 log 2 s."""

    def equations(self):
        yield self.tau * der(self.x) == -1 - gt.sqrt(self.x)


class Folding(gt.Model):
    """Slider-crank with equal links, no gravity: where slider and pivot meet, it may go on in two ways."""

    l = gt.parameter(1.0, unit="m", positive=True)
    m = gt.parameter(1.0, unit="kg", positive=True)
    p = gt.variable(2, unit="m", start=[0.8, 0.6])
    s = gt.variable(unit="m", start=1.6)
    pull = gt.variable(2, unit="N/m")

    def equations(self):
        rod = gt.vector([self.s - self.p[0], -self.p[1]])
        yield gt.dot(self.p, self.p) == self.l**2
        yield gt.dot(rod, rod) == self.l**2
        yield self.m * der(self.p, 2) == -self.pull[0] * self.p + self.pull[1] * rod
        yield self.m * der(self.s, 2) == -self.pull[1] * rod[0]


class Implicit(gt.Model):
    """y^3 - 3 y == x turns back where |x| = 2; no closed form."""

    x = gt.input(unit="1")
    y = gt.variable(unit="1", start=0.0)
    z = gt.variable(unit="s", start=0.0, fixed=True)

    def equations(self):
        yield self.y**3 - 3 * self.y == self.x
        yield der(self.z) == self.y


def test_growth_without_bound():
    run = simulate(Growing(), 2.0, throw=False)
    assert run.status is SolveStatus.DIVERGED
    assert run.message == "the motion ends at 1 s: the state grows without bound"
    t = run.trajectory.time
    assert 0.99 < t[-1] < 1.0 and run.trajectory["x"] == pytest.approx(1 / (1 - t), rel=1e-4)


class Oscillating(gt.Model):
    x = gt.variable(start=0.1, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    rate = gt.parameter(5.0, unit="1/s")

    def equations(self):
        yield der(self.x) == self.rate * self.v
        yield der(self.v) == -self.rate * self.x


@pytest.mark.parametrize("final_time", [1e8, 1e12, 1e50, 1e150])
def test_a_run_that_is_too_long_for_its_motion(final_time):
    run = simulate(Oscillating(), final_time, throw=False)
    assert run.status is SolveStatus.FAILED
    reason = f"because a run of {final_time:.3g} s is too long for so fast a motion: the integrator advances by "
    assert reason in run.message and run.message.endswith("simulate a shorter run")
    assert 0.1 < float(run.message.split("advances by ")[1].split()[0]) < 300.0  # 1000 steps, some 50 to a period


def test_a_formula_without_a_number_is_no_matter_of_the_length():
    class Logarithm(Oscillating):
        y = gt.variable()

        def equations(self):
            yield from super().equations()
            yield self.y == gt.log(self.x)

    run = simulate(Logarithm(), 1e3, throw=False)
    assert run.status is SolveStatus.FAILED and "too long" not in run.message


def test_the_edge_of_a_formula():
    run = simulate(Draining(), 2.0, throw=False)
    assert run.status is SolveStatus.FAILED
    ended = re.match(r"the motion ends at (\S+) s: the integrator's steps became too small there", run.message)
    assert ended and float(ended[1]) == pytest.approx(2 - 2 * np.log(2), abs=1e-4)


def test_where_no_choice_of_states_helps():
    run = simulate(Folding(), 3.0, start={"p": [0.8, 0.6], "s": 1.6, "der(p[0])": -0.6}, throw=False, tolerance=1e-10)
    assert run.status is SolveStatus.FAILED
    ended = re.match(
        r"the motion ends at (\S+) s,? (in a singular pose|where it leaves the model's range)", run.message
    )
    # s = 2 cos(phi): the energy gives the time until slider and pivot meet
    slowing = quad(lambda phi: np.sqrt((1 + 4 * np.sin(phi) ** 2) / 2.44), np.arctan2(0.6, 0.8), np.pi / 2)[0]
    assert ended and float(ended[1]) == pytest.approx(slowing, abs=1e-4)
    assert run.trajectory["s"][-1] > 0 and run.residual < 1e-9


def test_thrown_by_default_with_what_was_reached():
    with pytest.raises(NotSimulated, match="grows without bound") as error:
        simulate(Growing(), 2.0)
    assert len(error.value.simulation.trajectory) > 200


def test_stopped_on_the_way():
    seen = []

    def progress(time):
        seen.append(time)
        return time > 2.0

    run = simulate(Pendulum(), 10.0, progress=progress, throw=False)
    assert run.status is SolveStatus.INTERRUPTED and not run.status.ok
    assert run.message.startswith(f"stopped by request at {seen[-1]:.6g} s")
    assert 1.5 < run.trajectory.time[-1] <= seen[-1] < 4.0
    assert seen == sorted(seen) and len(run.trajectory) > 10


def test_progress_that_is_content_changes_nothing():
    run = simulate(Pendulum(), 1.0, progress=lambda time: False)
    assert run.trajectory == simulate(Pendulum(), 1.0).trajectory


class Dry(gt.Model):
    """Dry friction by sign()."""

    v = gt.variable(unit="m/s", start=1.0, fixed=True)
    a = gt.parameter(2.0, unit="m/s2")

    def equations(self):
        yield der(self.v) == -self.a * gt.sign(self.v)


class Turned(Dry):
    """The sign of a parameter is a number like others."""

    a = gt.parameter(-2.0, unit="m/s2")
    one = gt.parameter(1.0, unit="1/s")

    def equations(self):
        yield der(self.v) == self.one * self.v * gt.sign(self.a)


def test_sign_is_an_event_and_where_both_its_sides_push_back_the_run_ends_with_its_line():
    with pytest.raises(NotSimulated) as error:
        simulate(Dry(), 1.0)
    line = Dry.equations.__code__.co_firstlineno + 1
    assert error.match(rf"^at 0.5 s events do not settle: sign\(\) \(.*test_status\.py:{line}\) .*a mode in between")
    assert error.value.simulation.trajectory["v"][-1] == pytest.approx(0.0, abs=1e-12)


def test_the_sign_of_what_does_not_move_is_no_discontinuity():
    run = simulate(Turned(), 1.0, tolerance=1e-11)
    assert run.trajectory["v"][-1] == pytest.approx(np.exp(-1.0), abs=1e-9)


def test_structurally_sound_but_identically_singular():
    # the Sigma-method sees one degree of freedom; the truth is none: y = u - w'
    class Hidden(gt.Model):
        x = gt.variable()
        y = gt.variable()
        u = gt.input()
        w = gt.input()

        def equations(self):
            yield der(self.x) + der(self.y) + self.y == self.u
            yield self.x + self.y == self.w

    with pytest.raises(ModelError, match=r"rank 1 .*\(singular\): Hidden equation 1 .*Hidden equation 2"):
        simulate(Hidden(), 1.0, inputs={"u": 0.0, "w": 0.0})


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (dict(final_time=0.0), "must end after its start; found 0 s to 0 s"),
        (dict(final_time=np.nan), "must end after its start"),
        (dict(final_time=1.0, start_time=2.0), "must end after its start; found 2 s to 1 s"),
        (dict(final_time=1.0, step=0.0), "output interval must be positive and within the run; found 0 s"),
        (dict(final_time=1.0, step=2.0), "output interval .* found 2 s"),
        (dict(final_time=1.0, tolerance=0.0), "tolerance must be between 1e-14 and 0.1; found 0"),
        (dict(final_time=1.0, method="rk4"), "there is no integration method 'rk4'; use 'bdf' or 'adams'"),
        (dict(final_time=1.0, outputs="tensoin"), "has no variable 'tensoin'; did you mean 'tension'"),
        (dict(final_time=1.0, prefer="z"), "has no variable 'z'"),
    ],
)
def test_wrong_arguments(arguments, sentence):
    with pytest.raises(ModelError, match=sentence):
        simulate(Pendulum(), **arguments)


def test_a_misspelt_keyword():
    with pytest.raises(TypeError, match="has no argument 'input'; did you mean 'inputs'"):
        simulate(Pendulum(), 1.0, input={})  # type: ignore[call-arg]


def test_nothing_is_printed(capfd, recwarn):
    simulate(Growing(), 2.0, throw=False)
    simulate(Draining(), 2.0, throw=False)
    simulate(Implicit(), 1.0, inputs={"x": lambda t: 4 * t}, throw=False)
    simulate(Pendulum(), 1.0, inputs={}, start={"x": 1.0})
    simulate(l1(), 1.0, step=0.1, inputs={"T": lambda t: [0.5, -0.9 - np.sin(t), 0.3]}, throw=False)
    printed = capfd.readouterr()
    assert printed.out == printed.err == "" and not recwarn.list


class TestRecorded:
    def test_names_and_units(self):
        run = simulate(
            l1(), 0.01, step=0.01, inputs={"tau": 0.0}, start={"T": T0}, outputs=["arm[0].rod.tension", "der(q,2)"]
        )
        t = run.trajectory
        assert {"q", "T", "der(T)", "tau", "arm[0].rod.tension", "der(q,2)", "energy.stored"} <= set(t.names)
        units = {
            "q": "m",
            "der(T)": "m/s",
            "der(q,2)": "m/s2",
            "tau": "N",
            "arm[0].rod.tension": "N/m",
            "energy.stored": "J",
        }
        assert {name: t.unit(name) for name in units} == units
        assert t["T"].shape == (2, 3) and "arm[1].rod.tension" not in t

    def test_only_what_is_kept(self):
        more = {"inputs": {"tau": 0.0}, "start": {"T": T0}, "step": 0.05}
        whole = simulate(l1(), 0.1, outputs=["arm[0].rod.tension", "der(q)"], **more)
        names = ("arm[0].rod.tension", "T[1]", "der(q)")
        kept = simulate(l1(), 0.1, keep=names[:2], outputs=names[2], **more)
        energies = ("energy.stored", "energy.supplied", "energy.dissipated")
        assert kept.trajectory.names == (*names, *energies)
        assert all(np.array_equal(kept.trajectory[n], whole.trajectory[n]) for n in kept.trajectory.names)
        assert (kept.residual, kept.energy_error) == (whole.residual, whole.energy_error)

    def test_any_name_also_of_what_was_eliminated(self):
        t = simulate(
            l1(),
            0.01,
            step=0.01,
            inputs={"tau": 5.0},
            start={"T": T0},
            outputs=["plate.frame.r", "arm[0].motor.flange.f", "T[1]"],
        ).trajectory
        assert np.array_equal(t["plate.frame.r"], t["T"]) and np.array_equal(t["T[1]"], t["T"][:, 1])
        assert t["arm[0].motor.flange.f"] == pytest.approx([-5.0, -5.0])

    def test_matrices_by_their_entries(self):
        class Turning(gt.Model):
            phi = gt.variable(unit="rad", start=0.0, fixed=True)
            R = gt.variable((2, 2), unit="1")
            w = gt.parameter(2.0, unit="rad/s")

            def equations(self):
                c, s = gt.cos(self.phi), gt.sin(self.phi)
                yield der(self.phi) == self.w
                yield gt.vector([gt.vector([c, -s]), gt.vector([s, c])]) == self.R

        t = simulate(Turning(), 1.0).trajectory
        assert t["R[1,0]"][-1] == pytest.approx(np.sin(2.0), abs=1e-8)

    def test_rows(self):
        def times(**options):
            return simulate(Pendulum(), 1.0, **options).trajectory.time

        assert np.array_equal(times(), np.linspace(0.0, 1.0, 501))
        assert np.array_equal(times(step=0.1), np.linspace(0.0, 1.0, 11))
        assert times(step=0.3) == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.0])
        assert simulate(Pendulum(), 5.0, start_time=4.0, step=0.5).trajectory.time == pytest.approx([4.0, 4.5, 5.0])

    def test_rows_between_rows_change_nothing(self):
        coarse, fine = (
            simulate(l1(), 0.2, step=step, inputs={"tau": 0.0}, start={"T": T0}, tolerance=1e-11).trajectory
            for step in (0.1, 0.004)
        )
        assert coarse["T"] == pytest.approx(fine["T"][::25], abs=1e-10)

    def test_files_both_ways(self, tmp_path):
        t = simulate(SwingingPendulum(), 0.5, step=0.01).trajectory
        t.to_csv(tmp_path / "swing.csv")
        t.to_npz(tmp_path / "swing.npz")
        assert gt.Trajectory.from_csv(tmp_path / "swing.csv") == t
        assert gt.Trajectory.from_npz(tmp_path / "swing.npz") == t


def test_explicit_time():
    class Forced(gt.Model):
        """Pendulum whose pivot moves to and fro, written with time itself."""

        x = gt.variable(unit="m", start=0.6)
        y = gt.variable(unit="m", start=-0.8)
        pull = gt.variable(unit="1/s2")
        L = gt.parameter(1.0, unit="m")
        g = gt.parameter(9.81, unit="m/s2")
        w = gt.parameter(3.0, unit="rad/s")
        a = gt.parameter(0.5, unit="m")

        def equations(self):
            from_pivot = self.x - self.a * gt.sin(self.w * self.time)
            yield der(self.x, 2) == -self.pull * from_pivot
            yield der(self.y, 2) == -self.pull * self.y - self.g
            yield from_pivot**2 + self.y**2 == self.L**2

    run = simulate(Forced(), 3.0, start={"x": 0.6, "der(x)": 1.5}, tolerance=1e-12, method="adams")
    t = run.trajectory.time
    phi = solve_ivp(
        lambda t, y: [y[1], -9.81 * np.sin(y[0]) + 4.5 * np.sin(3 * t) * np.cos(y[0])],
        (0, 3), [np.arcsin(0.6), 0.0], "DOP853", t, rtol=1e-12, atol=1e-13,
    ).y[0]  # fmt: skip
    assert run.trajectory["x"] == pytest.approx(0.5 * np.sin(3 * t) + np.sin(phi), abs=1e-8)
    assert run.trajectory["y"] == pytest.approx(-np.cos(phi), abs=1e-8)
