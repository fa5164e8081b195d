"""Drawn motions, tests/suites/trajectory_draws.toml: a few in each run, all fifty and two hundred as proofs."""

from __future__ import annotations

import re
import time
from itertools import islice
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from gtmodel.motion import Starts
from gtmodel.motion.motion_study import solved
from gtmodel.motion.planning import plan_of
from gtmodel.motion.search import PATIENCE, REPEATED, RESERVE
from gtmodel.motion.task import FurtherStart, bent_guess, further_starts
from gtmodel.optimize.watch import Patience
from gtmodel.results import SolveStatus, Status, Work
from tests.support.draws import draws, suite
from tests.support.motions import asked, solution

FALSE_ALARM = 1e-3
NEAR_BEST = 5e-3  # of the cost of the best of five starts
LENGTHS_M = 1e-6
BEND_M = 0.15
OTHER_SEED = 777
LEAST_SOLVED = 199  # of 200
MOST_MEDIANS = 10  # of CPU time, one motion beside all


def searched(changes: dict[str, Any], starts: int, seed: int) -> tuple[bool, float, str]:
    """Whether it ends in an optimum on the declared branch, its cost over the best of all starts, and a line."""
    plan = plan_of(asked(**changes))
    search = plan.search(Work())
    solution = search.optimum()
    rng = np.random.default_rng(seed)
    others = search.from_starts([FurtherStart(bent_guess(plan.start, plan.goal, rng, BEND_M)) for _ in range(starts)])
    gap = solution.objective / min(s.objective for s in [solution, *others]) - 1
    told = f"{solution.status.value} {solution.objective:.6f} {search.iterations} {gap:.1e} {solution.message}"
    return solution.status.converged and on_the_branch(plan, solution), gap, told


def on_the_branch(plan, solution) -> bool:
    """Links of constant length from the carts, plate ahead of every cart by the margin; carts as inverse kinematics."""
    run, robot = solution.trajectory, plan.robot
    A, v, L = (np.asarray(getattr(robot, k), float) for k in "AvL")
    links = run["robot.T"][:, None, :] - A - run["robot.q"][:, :, None] * v
    along = np.sum(links * v, axis=2) / np.linalg.norm(v, axis=1)
    q, status = robot.causal("T", "q")(run["robot.T"])
    return bool(
        np.max(np.abs(np.linalg.norm(links, axis=2) - L)) < LENGTHS_M
        and along.min() >= plan.problem.limits.link_along_guideway * (1 - 1e-6)
        and np.all(status == Status.OK)
        and np.max(np.abs(q - run["robot.q"])) < LENGTHS_M
    )


@pytest.mark.parametrize("n", [0, *(pytest.param(n, marks=pytest.mark.proof) for n in (3, 9))])
def test_drawn(n):
    good, gap, told = searched(draws(n + 1)[n], 1, n)
    assert good and gap <= NEAR_BEST, told


def test_draws_are_what_they_say():
    first = draws(3)
    assert first == draws(3) and len(first) == 3  # the seed alone decides
    s = suite()
    for changes in first:
        a, b = (np.array(changes[f"{end}__tcp"]) for end in ("start", "goal"))
        assert np.linalg.norm(b - a) >= s["distance_m"]
        for end in (a, b):
            assert all(s[k][0] <= x <= s[k][1] for k, x in zip(("x_m", "y_m", "z_m"), end, strict=True))


@pytest.mark.proof
@pytest.mark.parametrize("seed", [None, OTHER_SEED])
def test_fifty(seed):
    """All 50 converge without help, on the declared branch, and of the declared suite at least 48 within 0.5 % of the
    best of five starts. Of another seed no fewer than that rate allows: 47 of 50 were seen."""
    results = [searched(changes, 4, n) for n, changes in enumerate(draws(seed=seed))]
    for n, (good, gap, told) in enumerate(results):
        print(n, good, f"{gap:.1e}", told)
    assert all(good for good, _, _ in results)
    least = 48 if seed is None else binom.ppf(FALSE_ALARM, 50, 48 / 50)
    assert sum(gap <= NEAR_BEST for _, gap, _ in results) >= least


# of another seed: attempts that got nowhere for 200 iterations, and one that needs more than 200 from its bent start
@pytest.mark.parametrize("n", [pytest.param(n, marks=pytest.mark.proof) for n in (1, 28)])
def test_drawn_with_another_seed(n):
    good, _, told = searched(draws(n + 1, OTHER_SEED)[n], 0, n)
    assert good, told


def test_an_attempt_may_take_as_long_as_it_gets_anywhere(monkeypatch):
    """No number of iterations ends an attempt that makes progress but the one that all attempts share."""
    plan = plan_of(asked(**draws(1)[0]))
    search = plan.search(Work())
    given = []

    def collocated(model, mesh, *, solver, **others):
        given.append(solver)
        raise Handed

    monkeypatch.setattr("gtmodel.motion.search.collocate", collocated)
    with pytest.raises(Handed):
        search.from_starts([FurtherStart(bent_guess(plan.start, plan.goal, np.random.default_rng(0), BEND_M))])
    (solver,) = given
    assert solver.max_iterations == plan.problem.solver.max_iterations - RESERVE
    slow, lost = Patience(), Patience()
    assert max(slow(1.0, 0.99**k) for k in range(solver.max_iterations)) < solver.patience
    assert max(lost(1.0, 1.0) for _ in range(solver.max_iterations)) > solver.patience


@pytest.mark.proof
def test_two_hundred_studies():
    """As `gtmodel solve` does, the exported motion and finer meshes included: solved, and none takes ten medians."""
    s = suite()
    failed, seconds = [], []
    for n, changes in enumerate(draws(s["study_count"], s["study_seed"])):
        began = time.process_time()
        study = solved(asked(**changes), Work())
        seconds.append(time.process_time() - began)
        if study.status is not SolveStatus.SOLVED:
            failed.append(f"{n}: {study.status.value} {study.message}")
    assert len(seconds) - len(failed) >= LEAST_SOLVED, failed
    assert max(seconds) <= MOST_MEDIANS * float(np.median(seconds)), (int(np.argmax(seconds)), max(seconds))


# iterations seen: 278 of the first, whose exported motion was sought beyond the edge of reach first, where a step cost
# as much as thirty (555); 191 of the second, whose finer mesh began with the barrier far from its end (517)
@pytest.mark.parametrize(("n", "most"), [pytest.param(74, 400, marks=pytest.mark.proof), (3, 400)])
def test_attempts_that_lead_nowhere_are_not_made_again(n, most):
    study = solved(asked(**draws(n + 1, suite()["study_seed"])[n]), Work())
    assert study.status is SolveStatus.SOLVED and study.iterations <= most, study.message


def test_further_starts_differ_in_kind():
    start, goal = np.array([0.0, -0.9, 0.1]), np.array([0.9, -0.9, 0.45])
    plan = plan_of(asked())
    four = list(islice(further_starts(start, goal, plan.line, np.random.default_rng(1), BEND_M), 4))
    one, other, line, bare = (s.guess["robot.T"] for s in four)
    straight = plan.line["robot.T"]
    assert np.max(np.abs(one - straight)) > 0.3 * BEND_M / np.sqrt(3)
    assert np.max(np.abs(one + other - 2 * straight)) < LENGTHS_M  # to one side and as far to the other
    assert np.array_equal(line, straight) and [s.barrier for s in four].count("monotone") == 1
    assert four[2].barrier == "monotone" and len(bare) == 2 and "robot.tau" not in four[3].guess


def test_starts_that_only_repeat_are_the_last():
    """Of the two optima 0.11 % apart at the largest weight of table 3.1, the better one, and how it is said."""
    study = solved(asked(cost__energy=0.01, starts=Starts(count=20, bend=0.4)), Work())
    assert study.status is SolveStatus.SOLVED and study.optima is not None and len(study.optima) == 2
    told = re.search(
        r"; local optimum; (\d+) of (\d+) starts ended here; (\d+) of 20 further starts skipped", study.message
    )
    assert told is not None, study.message
    here, starts, left_out = map(int, told.groups())
    assert REPEATED < starts == 21 - left_out < 21 and 1 < here < starts
    assert study.objective == pytest.approx(study.optima[0], rel=1e-9)


def test_one_start_says_nothing_of_others():
    study = solution(cost__energy=0.01)
    assert study.status is SolveStatus.SOLVED and "local optimum" not in study.message


class Handed(Exception):
    """The solver would start here."""


@pytest.mark.parametrize("most", [30, pytest.param(250, marks=pytest.mark.proof)])
def test_the_limit_of_iterations_is_that_of_all_attempts(most):
    """The first attempt at this one gets nowhere; 30 are too few for it, 250 for all of them."""
    o = solved(asked(**draws(2, OTHER_SEED)[1], solver__max_iterations=most), Work())
    assert o.status is SolveStatus.ITERATION_LIMIT and o.iterations == most


def test_starts_that_lead_nowhere_are_given_up():
    """From this bent line the plate stays beyond the edge of reach, and one iteration costs as much as twenty."""
    plan = plan_of(asked(**draws(16)[15]))
    search = plan.search(Work())
    rng = np.random.default_rng(15)
    assert search.from_starts([FurtherStart(bent_guess(plan.start, plan.goal, rng, BEND_M))]) == []
    assert search.started == 1 and search.iterations <= 2 * PATIENCE
