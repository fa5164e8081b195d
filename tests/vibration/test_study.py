"""The vibration study, called on objects: synthetic recordings of a known structure, steps, hits, printed matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gtmodel.results import ArgumentError, SolveStatus
from gtmodel.vibration import (
    Impulse,
    KnownMass,
    Physical,
    StepResponse,
    Subspace,
    VibrationStudy,
    from_known,
    identify_subspace,
    matrices_study,
    output_error,
    physical_form,
    step_record,
    structure_record,
    study,
    synthetic_records,
)
from tests.vibration.structures import FEW, FORCED, HIT, OF_HIT, OF_STEPS, PRINTED, STEPS, TS, TWO, D, K, M

EXACT = 1e-12  # relative: the same computation


@pytest.fixture(scope="module")
def records():
    return synthetic_records(TWO, FEW)


def of_two(records, physical=FORCED, model=Subspace(), **more):  # noqa: B008  # frozen
    return study(records, model, physical=physical, truth=TWO, title="two masses", **more)


@pytest.fixture(scope="module")
def two_mass(records):
    return of_two(records)


def test_two_masses_from_their_positions(two_mass) -> None:
    s = two_mass
    assert s.status is SolveStatus.SOLVED
    assert s.order == s.order_by_gap == 4 and s.synthetic == "seed 63, noise 1e-05 m"
    np.testing.assert_allclose(s.frequency, [5.83612, 16.80977], rtol=1e-3)
    np.testing.assert_allclose(s.M, M, atol=0.1)
    for name, (low, high) in s.intervals.items():
        true = {"M": M, "D": D, "K": K}[name[0]][int(name[2]), int(name[4])]
        middle, half = (low + high) / 2, (high - low) / 2
        assert abs(true - middle) < 2 * half, name  # four standard deviations
    assert "M s^2 + D s + K is stable" in s.notes and not any("identifiable" in w for w in s.notes)
    assert s.checks["largest_pole"].passed and s.checks["matrix_error"].bound == 1e-3
    assert all(text.startswith("# synthetic: seed 63") for text in s.files.values())
    for name in ("order", "held_out", "response"):
        assert "synthetic: seed 63" in s.figure(name).get_suptitle()


def test_without_a_force_the_masses_stay_open(records) -> None:
    found = of_two(records, Physical())
    assert found.M is None and found.intervals is None
    assert "M is not identifiable without a known force or mass; M^-1 K and M^-1 D are" in found.notes
    np.testing.assert_allclose(found.M_inv_K, np.linalg.solve(M, K), rtol=5e-3)
    assert set(found.files) == {"model.toml"}


def test_a_known_mass_does_as_well(records) -> None:
    mass = [KnownMass(1, 30.0)]
    found = of_two(records, Physical(mass=mass))
    np.testing.assert_allclose(np.diag(found.M), [30.0, 12.0], rtol=0.02)
    assert found.intervals is None and any(w.startswith("only masses are known") for w in found.notes)
    both = of_two(records, Physical(force_coordinates=[1], mass=mass))
    assert "known masses start the output-error fit but do not constrain it" in both.notes


def test_a_mass_that_contradicts_the_force_is_said(records) -> None:
    def words(mass: float) -> list[str]:
        given = Physical(force_coordinates=[1], mass=[KnownMass(1, mass)])
        return [w for w in of_two(records, given).notes if w.startswith("the mass of")]

    assert words(30.0) == []
    assert len(words(60.0)) == 1 and "set to 60 kg; force and recording give" in words(60.0)[0]


def test_a_model_that_predicts_nothing_says_so() -> None:
    loud = synthetic_records(TWO, replace(FEW, noise=0.3))
    found = of_two(loud, Physical(refine=False), Subspace(order=4))
    assert sum("held-out samples are predicted" in w for w in found.notes) == 2


def test_a_recording_that_nobody_made_up() -> None:
    record = replace(
        structure_record(M, D, K, force=50.0, samples=1500, sample_time=TS, noise=1e-5, seed=4, hold=8), synthetic=None
    )
    found = study(record, Subspace(block_rows=10, largest_order=6), physical=FORCED)
    model = identify_subspace(record, block_rows=10, largest=6)
    fit = output_error(record, from_known(physical_form(model.system), force=[1.0, 0.0]))
    np.testing.assert_allclose(found.K, fit.model.K, rtol=EXACT)
    assert found.synthetic is None and "matrix_error" not in found.checks
    # the picture of a log shows no word that it is not
    assert "synthetic" not in found.figure("order").get_suptitle()


def test_printed_matrices() -> None:
    found = matrices_study(PRINTED, title="Compliance matrices")
    np.testing.assert_allclose(found.frequency, [13.826, 103.337], atol=5e-4)
    assert found.checks["published_Hz"].passed and found.stable is False
    assert found.signs[3] == "D and K flipped: stable, poles at 14.21, 100.6 Hz"
    assert found.definite["signs"] == "D and K flipped" and found.message == "unstable as printed; see the signs"
    assert found.figure("poles").axes[0].get_title().startswith("Compliance matrices")
    wrong = matrices_study(replace(PRINTED, published=[14.0, 105.0]))
    assert not wrong.checks["published_Hz"].passed and wrong.status is SolveStatus.CHECK_FAILED


def test_steps_and_hits() -> None:
    step = study(synthetic_records(STEPS, OF_STEPS), StepResponse(), truth=STEPS)
    assert step.delay_samples == 5 and all(c.passed for c in step.checks.values())
    assert step.bandwidth[0] == pytest.approx(1.43, abs=0.01)
    assert "too slow" in step.notes[1] and "seeds 611 to 613" in step.figure("step").get_suptitle()
    records = synthetic_records(HIT, OF_HIT)
    hit = study(records, Impulse(), truth=HIT)
    np.testing.assert_allclose(hit.frequency, [7.4, 11.45], rtol=1e-3)
    assert hit.checks["frequency_error"].passed and "seed 64" in hit.figure("impulse").get_suptitle()
    assert not study(records, Impulse(modes=1), truth=HIT).checks["modes_found"].passed


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("known", "model", "sampling"),
    [
        (STEPS, StepResponse(), replace(OF_STEPS, noise=2e-4)),
        (HIT, Impulse(modes=2), replace(OF_HIT, noise=1.5e-4)),
    ],
)
def test_errors_that_noise_explains_fail_no_check(known, model, sampling, seed: int) -> None:
    noisy = study(synthetic_records(known, replace(sampling, seed=seed + 1)), model, truth=known)
    assert noisy.checks and all(check.passed for check in noisy.checks.values()), noisy.checks


@pytest.mark.parametrize(
    ("known", "model", "sampling"),
    [(TWO, Subspace(), FEW), (STEPS, StepResponse(), OF_STEPS), (HIT, Impulse(), OF_HIT)],
)
def test_a_stop_is_heard_between_the_steps_of_a_fit(known, model, sampling) -> None:
    """Asked once before the fit and at every order, delay, number of resonances and iteration of it."""
    physical = FORCED if known is TWO else None
    records = synthetic_records(known, sampling)
    for after in (1, 2, 4):
        asked: list[None] = []

        def stop(asked=asked, after=after) -> bool:
            asked.append(None)
            return len(asked) > after

        found = study(records, model, physical=physical, truth=known, stop=stop)
        assert found.status is SolveStatus.INTERRUPTED and len(asked) == after + 1
        assert found.frequency is None and not found.files and not found.rows


def test_every_study_tells_the_same_values(two_mass) -> None:
    names = list(VibrationStudy(status=SolveStatus.SOLVED).values)
    for found in (two_mass, matrices_study(PRINTED)):
        assert [name for name in found.values if name != "notes"] == names


ONE = structure_record(M, D, K, force=50.0, samples=1000, sample_time=TS, noise=1e-5, seed=4, hold=8)
STEP = step_record(0.9656, 0.03425, 5, 1e-3, samples=200, before=20, sample_time=TS, noise=5e-6, seed=1)


@pytest.mark.parametrize(
    ("records", "model", "more", "argument"),
    [
        (ONE, Subspace(block_rows=10, order=30), {}, "model"),
        (ONE, Subspace(block_rows=10, order=3), {"physical": FORCED}, "model"),
        (ONE, Subspace(block_rows=300), {}, "model"),
        (ONE, Subspace(order=4), {"physical": Physical(force_coordinates=[3])}, "physical.force_coordinates"),
        (ONE, Subspace(order=4), {"physical": FORCED, "input_unit": "m"}, "physical.force_coordinates"),
        (ONE, Subspace(order=4), {"physical": Physical(mass=[KnownMass(4, 1.0)])}, "physical.mass[0].coordinate"),
        ([STEP, STEP], Subspace(), {}, "records"),
        ([], StepResponse(), {}, "records"),
        (STEP, StepResponse(delay_samples=180), {}, "model"),
        (STEP, StepResponse(), {"physical": FORCED}, "physical"),
        (STEP, StepResponse(), {"truth": HIT}, "truth"),
    ],
)
def test_what_cannot_be_used_is_named(records, model, more, argument) -> None:
    with pytest.raises(ArgumentError) as caught:
        study(records, model, **more)
    assert caught.value.argument == argument and caught.value.message


@pytest.mark.parametrize(
    ("known", "argument"),
    [(replace(TWO, coordinate=3), "known.coordinate"), (replace(HIT, damping=[0.1]), "known")],
)
def test_a_system_that_cannot_be_made_up_is_named(known, argument) -> None:
    with pytest.raises(ArgumentError) as caught:
        synthetic_records(known, FEW)
    assert caught.value.argument == argument


@pytest.mark.parametrize(
    ("change", "argument"),
    [({"M": [[1.0]]}, "matrices"), ({"published": [14.0]}, "matrices.published"), ({"M": [[1], []]}, "M")],
)
def test_matrices_that_do_not_fit_are_named(change, argument) -> None:
    with pytest.raises(ArgumentError) as caught:
        matrices_study(replace(PRINTED, **change))
    assert caught.value.argument == argument
