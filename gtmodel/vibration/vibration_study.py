"""The vibration study: the model of a recording, and what the recording does not determine.

State-space models are studied here: physical form, M, D, K and modes, table, plots and files. Studies of step responses
and decays are next to their fits, in step_response.py and impulse.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple, Unpack

import numpy as np
import tomli_w

from ..linear.state_space import frequency_and_damping
from ..results import ArgumentError, Check, Row, SolveStatus, Work, at_most
from ..results.work import WorkOptions, study_function
from .impulse import ImpulseStudy, impulse_study
from .modes import Modes, modes
from .options import Hit, Impulse, Physical, StepResponse, Steps, Subspace, SyntheticStructure
from .output_error import OutputErrorFit, output_error
from .physical_form import PhysicalForm, SecondOrder, continuous, from_known, physical_form
from .record import FitStopped, Record
from .step_response import StepStudy, step_study
from .subspace import SubspaceModel, identify_subspace
from .vibration_result import VibrationStudy, commented, entitled, interval, numbers, pairs_of, rows_of

POOR = 30.0  # percent of fit: below, a model explains less than half of the variance
WITHIN = 1e-3  # for synthetic structures: largest relative error (2-norm) of M, D and K


class _Structure(NamedTuple):
    """Results of the physical form; `known` is None without a known force or mass."""

    form: PhysicalForm
    known: SecondOrder | None
    fit: OutputErrorFit | None
    modes: Modes | None

    @property
    def best(self) -> SecondOrder | None:
        """M, D, K fitted to the recording, else those from a known force or mass."""
        return self.fit.model if self.fit else self.known


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SubspaceStudy(VibrationStudy):
    """A state-space model of a recording. model: the fit; form, fit: the physical form, if requested."""

    model: SubspaceModel | None = None
    form: PhysicalForm | None = None
    fit: OutputErrorFit | None = None

    def _model_rows(self) -> list[Row]:
        m = self.model
        if m is None or self.frequency is None or self.damping is None:
            return []
        rows = [
            Row("order", m.order),
            Row("fit on held-out samples", numbers(m.held_out_fit), "%"),
            Row("residual, rms", numbers(1e6 * m.residual, ".4g"), "um"),
            Row("modes", numbers(self.frequency), "Hz"),
            Row("damping", numbers(self.damping, ".4g")),
        ]
        if self.form is not None:
            rows += [
                Row("M^-1 K", rows_of(self.form.M_inv_K), "1/s2"),
                Row("M^-1 D", rows_of(self.form.M_inv_D), "1/s"),
                Row("velocity jump left in B", self.form.jump),
            ]
        units = {"M": "kg", "D": "kg/s", "K": "N/m"}
        if self.fit is not None:
            e = self.fit.estimate
            rows += [Row(n, f"{e.value(n):.6g}{interval(e.interval(n), '.6g')}", units[n[0]]) for n in e.names]
        elif self.M is not None:
            rows += [Row(n, rows_of(getattr(self, n)), unit) for n, unit in units.items()]
        return rows


def subspace_study(
    record: Record,
    how: Subspace,
    physical: Physical | None,
    truth: SyntheticStructure | None,
    input_unit: str,
    title: str,
    interrupted: Callable[[], bool],
) -> SubspaceStudy:
    """Identify the model, transform it and check it. Raises ArgumentError, FitStopped."""
    model = identify_subspace(
        record, order=how.order, method=how.method, block_rows=how.block_rows, largest=how.largest_order,
        feedthrough=how.feedthrough, held_out=how.held_out, interrupted=interrupted,
    )  # fmt: skip
    c = continuous(np.asarray(model.system.A), np.asarray(model.system.B), record.sample_time)
    poles = np.linalg.eigvals(c.A)
    poles = poles[np.lexsort((-poles.imag, np.abs(poles).round(9)))]
    s = None if physical is None else _structure(physical, model, record, input_unit, interrupted)
    frequency, damping = frequency_and_damping(poles[poles.imag >= 0])
    best = None if s is None else s.best
    return SubspaceStudy(
        status=SolveStatus.SOLVED,
        message=f"{model.method}, order {model.order}, {len(record)} samples",
        title=title,
        checks=_checks(model, best, truth),
        figures=_figures(record, model, c.A, title or "vibration", input_unit),
        files=_files(model, best, record),
        machine_files=("parameters.toml", "model.toml", "model.c"),
        model=model,
        form=None if s is None else s.form,
        fit=None if s is None else s.fit,
        notes=_notes(physical, model, c.message, s),
        estimate=s.fit.estimate if s and s.fit else None,
        frequency=s.modes.frequency_Hz if s and s.modes else frequency,
        damping=damping,
        order=model.order,
        order_by_gap=model.gap_order,
        singular_values=model.singular_values,
        held_out_fit=model.held_out_fit,
        held_out_rms={str(t.order): t.held_out_rms for t in model.trials},
        residual=model.residual,
        poles=pairs_of(poles),
        M_inv_K=None if s is None else s.form.M_inv_K,
        M_inv_D=None if s is None else s.form.M_inv_D,
        M=None if best is None else best.M,
        D=None if best is None else best.D,
        K=None if best is None else best.K,
        intervals={n: list(s.fit.estimate.interval(n)) for n in s.fit.estimate.names} if s and s.fit else None,
        stable=bool(np.abs(model.poles).max() < 1),
        synthetic=record.synthetic,
    )


def _structure(
    p: Physical, model: SubspaceModel, record: Record, input_unit: str, interrupted: Callable[[], bool]
) -> _Structure:
    form = physical_form(model.system)
    coordinates = len(form.M_inv_K)
    force = None
    if p.force_coordinates:
        if input_unit != "N":
            raise ArgumentError("the input is not a force in newtons", "physical.force_coordinates")
        inputs = record.u.shape[1]
        if len(p.force_coordinates) != inputs or not all(1 <= c <= coordinates for c in p.force_coordinates):
            raise ArgumentError(
                f"found {p.force_coordinates}; expected one coordinate from 1 to {coordinates} per input ({inputs})",
                "physical.force_coordinates",
            )
        force = np.eye(coordinates)[:, [c - 1 for c in p.force_coordinates]]
    for n, m in enumerate(p.mass):
        if m.coordinate > coordinates:
            raise ArgumentError(f"is {m.coordinate}; the model has {coordinates}", f"physical.mass[{n}].coordinate")
    if force is None and not p.mass:
        return _Structure(form, None, None, None)
    try:
        known = from_known(form, force=force, masses={m.coordinate - 1: m.mass for m in p.mass})
        # with known masses alone the force is an estimate; there is nothing to fit with
        refine = p.refine and force is not None
        fit = output_error(record, known, form=p.form, interrupted=interrupted) if refine else None
    except ArgumentError as error:
        raise ArgumentError(str(error), "physical") from error
    best = fit.model if fit else known
    return _Structure(form, known, fit, modes(best.M, best.D, best.K))


def _notes(p: Physical | None, model: SubspaceModel, near: str, s: _Structure | None) -> list[str]:
    notes = [f"order {model.order}: {model.why}"]
    if near:
        notes.append(near)
    notes += [
        f"output {k + 1}: held-out samples are predicted {'worse' if fit < 0 else 'little better'} than by their mean "
        f"(fit {fit:.3g} %), so the model is unreliable; excite more, reduce noise and trends, check the columns"
        for k, fit in enumerate(model.held_out_fit)
        if fit < POOR
    ]
    if s is None or p is None:
        return notes
    if p.mass and s.known is not None and p.refine:
        notes.append(
            "known masses start the output-error fit but do not constrain it"
            if s.fit
            else "only masses are known: M, D, K follow from M^-1 K and M^-1 D, without intervals"
        )
    if s.fit is not None:
        e = s.fit.estimate
        for m in p.mass:
            name = f"M[{m.coordinate - 1},{m.coordinate - 1}]"
            low, high = e.interval(name)
            if not low - 0.01 * m.mass <= m.mass <= high + 0.01 * m.mass:
                notes.append(
                    f"the mass of coordinate {m.coordinate} is set to {m.mass:g} kg; force and recording give "
                    f"{e.value(name):.5g} ({low:.5g} .. {high:.5g}) kg: check mass, force and its coordinate"
                )
    # if M is known, the note that it needs a force or a mass is obsolete
    notes += [w for w in s.form.notes if w != near and (s.known is None or w != s.form.notes[0])]
    notes += [
        *(s.known.notes if s.known and not s.fit else ()),
        *(s.modes.notes if s.modes else ()),
        *(s.fit.notes if s.fit else ()),
    ]
    return notes


def _checks(model: SubspaceModel, best: SecondOrder | None, true: SyntheticStructure | None) -> dict[str, Check]:
    radius = float(np.abs(model.poles).max())
    checks = {"largest_pole": at_most(radius, 1.0, "set another order")}
    if true is not None and best is not None:
        error = max(
            float(np.linalg.norm(X - np.array(x)) / np.linalg.norm(x))
            for X, x in ((best.M, true.M), (best.D, true.D), (best.K, true.K))
        )
        checks["matrix_error"] = at_most(error, WITHIN)
    return checks


def _files(model: SubspaceModel, best: SecondOrder | None, record: Record) -> dict[str, str]:
    S = model.system
    box = {
        "sample_time_s": record.sample_time,
        **{name: np.asarray(getattr(S, name)).tolist() for name in "ABCD"},
        "initial_state": model.initial_state.tolist(),
        "offset": model.offset.tolist(),
    }
    files = {"model.toml": "# x[k+1] = A x + B u, y = C x + D u + offset\n" + tomli_w.dumps(box)}
    if best is not None:
        matrices = {"M_kg": best.M.tolist(), "D_kg_s": best.D.tolist(), "K_N_m": best.K.tolist()}
        files["parameters.toml"] = tomli_w.dumps(matrices)
    return {name: commented(text, record.synthetic) for name, text in files.items()}


def _figures(record: Record, model: SubspaceModel, A: np.ndarray, title: str, input_unit: str) -> dict[str, Any]:
    def titled(what: str) -> str:
        return entitled(f"{title}: {what}", record.synthetic)

    return {
        "order": partial(_order_figure, model, titled("order")),
        "held_out": partial(_prediction_figure, record, model, titled("prediction of held-out samples")),
        "response": partial(_response_figure, record, model, A, titled("frequency response"), f"m/{input_unit}"),
    }


def _order_figure(model: SubspaceModel, title: str) -> Any:
    from ..plot.vibration import order_figure

    trials = [(t.order, t.held_out_rms) for t in model.trials]
    return order_figure(model.singular_values, trials, model.order, title=title)


def _prediction_figure(record: Record, model: SubspaceModel, title: str) -> Any:
    from ..plot.vibration import prediction_figure

    return prediction_figure(
        record.time, record.y, model.prediction, model.first_held_out, model.held_out_fit, title=title
    )


def _response_figure(record: Record, model: SubspaceModel, A: np.ndarray, title: str, unit: str) -> Any:
    from ..plot.vibration import response_figure

    S = model.system
    poles = np.linalg.eigvals(A)
    marks = np.unique((np.abs(poles[poles.imag > 0]) / (2 * np.pi)).round(9))
    return response_figure(
        (np.asarray(S.A), np.asarray(S.B), np.asarray(S.C), np.asarray(S.D)), record.sample_time, marks,
        title=title, unit=unit,
    )  # fmt: skip


_KNOWN = {Subspace: SyntheticStructure, StepResponse: Steps, Impulse: Hit}
_STUDIES = {Subspace: SubspaceStudy, StepResponse: StepStudy, Impulse: ImpulseStudy}


@study_function
def study(
    records: Record | Sequence[Record],
    model: Subspace | StepResponse | Impulse,
    *,
    physical: Physical | None = None,
    input_unit: Literal["N", "m"] = "N",
    truth: SyntheticStructure | Steps | Hit | None = None,
    **work_options: Unpack[WorkOptions],
) -> VibrationStudy:
    """Fit a model to recordings of positions [m].

    Args:
        records: one recording, or several step responses.
        model: `Subspace` for a state-space model, `StepResponse` for a delayed first-order model, `Impulse` for the
            resonances of a decay.
        physical: prior knowledge that turns a state-space model into M, D, K.
        input_unit: unit of the inputs: "N" for forces, "m" for references.
        truth: the system behind synthetic recordings (`synthetic_records`), to check the result.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    An interrupted study has no model. Raises ArgumentError.

    >>> from gtmodel.vibration import Hit, Impulse, Sampling, study, synthetic_records
    >>> hit = Hit(frequency=[7.4], damping=[0.03], amplitude=[[5e-4]])
    >>> records = synthetic_records(hit, Sampling(seed=1, noise=1e-6, samples=500))
    >>> round(study(records, Impulse(modes=1), truth=hit).frequency[0], 1)
    7.4
    """
    work = Work(**work_options)
    recordings = [records] if isinstance(records, Record) else list(records)
    if physical is not None and not isinstance(model, Subspace):
        raise ArgumentError("needs a Subspace model", "physical")
    if truth is not None and not isinstance(truth, _KNOWN[type(model)]):
        raise ArgumentError(f"expected {_KNOWN[type(model)].__name__}; found {type(truth).__name__}", "truth")
    if not recordings or (len(recordings) > 1 and not isinstance(model, StepResponse)):
        raise ArgumentError(f"found {len(recordings)} recordings; this model needs exactly one", "records")
    if work.interrupted():
        return _STUDIES[type(model)](
            status=SolveStatus.INTERRUPTED, message="stopped before the fit", title=work.title
        )  # fmt: skip
    work.progress("fitting", 0.3)
    try:
        if isinstance(model, Subspace):
            return subspace_study(recordings[0], model, physical, truth, input_unit, work.title, work.interrupted)  # type: ignore[arg-type]
        if isinstance(model, StepResponse):
            return step_study(recordings, model, truth, work.title, work.interrupted)  # type: ignore[arg-type]
        return impulse_study(recordings[0], model, truth, work.title, work.interrupted)  # type: ignore[arg-type]
    except FitStopped as stopped:
        return _STUDIES[type(model)](status=SolveStatus.INTERRUPTED, message=str(stopped), title=work.title)
    except ArgumentError as error:
        raise ArgumentError(error.message, error.argument or "model") from error
