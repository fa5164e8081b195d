"""One level for all tests of data of a run."""

from __future__ import annotations

import numpy as np

from gtmodel.results.suspicion import RUN_LEVEL, Suspicion, alarms, suspicion_checks


def named(p: float, name: str = "drift") -> Suspicion:
    return Suspicion(name, f"p is {p:g}", p, "measure again")


def test_clean_data_raise_any_alarm_as_seldom_as_the_level_says() -> None:
    rng = np.random.default_rng(5)
    runs = 20_000
    raised = sum(bool(alarms([named(p) for p in rng.random(8)])) for _ in range(runs))
    four_deviations = 4 * np.sqrt(RUN_LEVEL / runs)
    assert abs(raised / runs - RUN_LEVEL) < four_deviations


def test_dependent_tests_raise_no_more() -> None:
    rng = np.random.default_rng(6)
    raised = sum(bool(alarms([named(p)] * 8)) for p in rng.random(20_000))
    assert raised / 20_000 <= RUN_LEVEL


def test_a_test_that_is_not_a_number_raises_nothing() -> None:
    untested = named(float("nan"))
    assert alarms([untested]) == []
    assert [s.p for s in alarms([untested, named(0.0), untested])] == [0.0]


def test_checks_keep_the_order_and_accepted_alarms_are_sentences() -> None:
    found = [named(0.0, "drift"), named(0.5, "colour"), named(0.0, "frame")]
    checks, sentences = suspicion_checks(found, accept=["frame"])
    assert list(checks) == ["drift", "colour"]
    assert [check.passed for check in checks.values()] == [False, True]
    assert sentences == ["p is 0; measure again", "accepted (frame): p is 0"]
