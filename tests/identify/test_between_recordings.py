"""Several recordings of one machine: where they disagree beyond their noise, the study says so."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.identify import Fitting, IdentificationStudy, LogSimulator, Sensors, multisine, study
from gtmodel.measurements import ESTIMATE, Session, Signal
from gtmodel.results import ArgumentError

TIME = 0.004 * np.arange(3000)


class Drive(gt.Model):
    """A cart with viscous and Coulomb friction."""

    m, d, c = gt.parameter(95.0, unit="kg"), gt.parameter(200.0, unit="kg/s"), gt.parameter(20.0, unit="N")
    q, tau = gt.variable(unit="m"), gt.variable(unit="N")

    def equations(self):
        v = gt.der(self.q)
        yield self.tau == self.m * gt.der(v) + self.d * v + self.c * gt.sign(v)


def recorded(mass: float, seed: int, offset: float = 0.0) -> Session:
    q = multisine(TIME, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=seed)[:, 0]
    log = LogSimulator(Drive(m=mass), q).draw(seed, Sensors(effort_noise=3.0))
    return Session(f"day {seed}", log.with_values({"tau": log["tau"] + offset}), 0.004)


def solve(*logs: Session, **options) -> IdentificationStudy:
    return study(Drive(), list(logs), ["m", "d", "c"], **options)


def disagreement(s: IdentificationStudy) -> list[str]:
    return [n for n in s.notes if n.startswith("recordings have disjoint 95 % intervals")]


def test_disjoint_masses_are_said_with_how_much() -> None:
    s = solve(recorded(95.0, 1), recorded(96.0, 2))
    (sentence,) = disagreement(s)
    assert "of 1 of 3 parameters, the worst is m:" in sentence and "day 1" in sentence and "not the machine" in sentence
    first, second = s.by_recording["m"]["day 1"], s.by_recording["m"]["day 2"]
    assert first[1] < second[0]
    assert np.mean(first) == pytest.approx(95.0, abs=0.1) and np.mean(second) == pytest.approx(96.0, abs=0.1)
    # the joint interval holds neither: that is why it is said
    low, high = s.interval("m")
    assert first[1] < low and high < second[0]
    assert s.between_recordings["m"] == pytest.approx(np.sqrt(0.5), rel=0.1)
    # by itself each recording gives what a study of it alone gives
    alone = solve(recorded(95.0, 1), processing=gt.identify.Processing(cutoff=s.cutoff))
    assert first == pytest.approx(list(alone.interval("m")), rel=1e-9)
    assert "m by recording" in str(s)


def test_recordings_that_agree_and_one_alone_say_nothing() -> None:
    s = solve(*(recorded(95.0, k) for k in (1, 2, 3)))
    assert not disagreement(s) and s.between_recordings is None and set(s.by_recording) == {"m", "d", "c"}
    one = solve(recorded(95.0, 1))
    assert one.by_recording is None and not disagreement(one)


def test_a_held_out_recording_of_another_mass_is_said_too() -> None:
    s = solve(recorded(95.0, 1), held_out=[recorded(97.0, 2)])
    assert "day 2" in disagreement(s)[0]


def test_offsets_by_session_are_no_parameters_of_the_machine() -> None:
    signals = {"q": Signal("q", "m"), "tau": Signal("tau", "N", offset=ESTIMATE)}
    s = solve(recorded(95.0, 1, 5.0), recorded(95.0, 2, -7.0), signals=signals)
    assert not disagreement(s) and set(s.by_recording) == {"m", "d", "c"}
    assert len([n for n in s.corrections if "offset" in n]) == 2


def test_what_a_recording_alone_does_not_determine_is_not_compared() -> None:
    quiet = recorded(95.0, 2)
    still = Session("still", quiet.trajectory.with_values({"q": 1e-7 * quiet.trajectory["q"]}), 0.004)
    s = solve(recorded(95.0, 1), recorded(96.0, 3), still, fitting=Fitting(nonnegative=["m"]))
    assert set(s.by_recording["m"]) >= {"day 1", "day 3"} and disagreement(s)


def test_a_recording_that_is_given_twice_is_refused_unless_that_is_accepted() -> None:
    day = recorded(95.0, 1)
    again = Session("again", day.trajectory, 0.004)
    with pytest.raises(ArgumentError, match=r'\'again\' repeat .* if it is right, accept = \["copied_rows"\]'):
        solve(day, again)
    s = solve(day, again, fitting=Fitting(accept=["copied_rows"]))
    assert any(n.startswith("accepted (copied_rows)") and "'again'" in n for n in s.notes)


def test_recordings_whose_positions_have_other_widths_are_refused_by_what_evaluates_them() -> None:
    one, two = recorded(95.0, 1), recorded(95.0, 2)
    wide = two.trajectory.with_values({"q": np.column_stack([two.trajectory["q"]] * 2)})
    with pytest.raises(TypeError, match="'q' takes shape"):
        solve(one, Session("wide", wide, 0.004))
