"""Kind "vibration", model "subspace": state-space model, physical form, M, D, K and modes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import tomli_w

from gtmodel.problem_files.base import Check, Context, InputError, Outcome, Row, at_most
from gtmodel.results import SolveStatus
from gtmodel.vibration import (
    Modes,
    OutputErrorFit,
    PhysicalForm,
    Record,
    SecondOrder,
    SubspaceModel,
    ArgumentError,
    continuous,
    from_known,
    identify_subspace,
    modes,
    output_error,
    physical_form,
)

from .vibration_keys import Physical, Schema
from .vibration_values import interval, listed, pairs_of, rows_of, said, values

POOR = 30.0  # percent of fit: below, a model explains less than half of the variance
WITHIN = 1e-3  # of synthetic structures: largest relative error (2-norm) of M, D and K; the bound


class _Structure(NamedTuple):
    """What the physical form gave; `known` None without a force or a mass."""

    form: PhysicalForm
    known: SecondOrder | None
    fit: OutputErrorFit | None
    modes: Modes | None


def solve_subspace(problem: Schema, records: list[Record], context: Context) -> Outcome:
    """Identify, transform, judge. Raises ArgumentError, InputError, Stopped."""
    record, k = records[0], problem.subspace
    model = identify_subspace(
        record, order=k.order, method=k.method, block_rows=k.block_rows, largest=k.largest_order,
        feedthrough=k.feedthrough, held_out=k.held_out, interrupted=context.interrupted,
    )  # fmt: skip
    A, B = np.asarray(model.system.A), np.asarray(model.system.B)
    c = continuous(A, B, record.sample_time)
    poles = np.linalg.eigvals(c.A)
    poles = poles[np.lexsort((-poles.imag, np.abs(poles).round(9)))]
    s = None if problem.physical is None else _structure(problem, problem.physical, model, record, context)
    upper = poles[poles.imag >= 0]
    frequency = s.modes.frequency_Hz if s and s.modes else np.abs(upper) / (2 * np.pi)
    damping = -upper.real / np.abs(upper)
    found = values(
        words=_words(problem.physical, model, c.said, s),
        frequency_Hz=frequency,
        damping=damping,
        order=model.order,
        order_by_gap=model.gap_order,
        singular_values=model.singular_values,
        held_out_fit_percent=model.held_out_fit,
        held_out_rms_m={str(t.order): t.held_out_rms for t in model.trials},
        residual_m=model.residual,
        poles_1_s=pairs_of(poles),
        M_inv_K_1_s2=s and s.form.M_inv_K,
        M_inv_D_1_s=s and s.form.M_inv_D,
        stable=bool(np.abs(model.poles).max() < 1),
        synthetic=record.synthetic,
    )
    best = None if s is None else (s.fit.model if s.fit else s.known)
    if best is not None:
        found |= {"M_kg": best.M, "D_kg_s": best.D, "K_N_m": best.K}
    if s and s.fit:
        found["intervals"] = {n: list(s.fit.estimate.interval(n)) for n in s.fit.estimate.names}
    return Outcome(
        status=SolveStatus.SOLVED,
        message=f"{model.method}, order {model.order}, {len(record)} samples",
        checks=_checks(problem, model, best),
        values=found,
        rows=_rows(model, found, s, best),
        figures=_figures(problem, record, model, c.A, s),
        files=_files(model, best, record),
        machine_files=("parameters.toml", "model.toml", "model.c"),
    )


def _structure(problem: Schema, p: Physical, model: SubspaceModel, record: Record, context: Context) -> _Structure:
    form = physical_form(model.system)
    coordinates = len(form.M_inv_K)
    force = None
    if p.force_coordinates:
        if problem.measurements is not None and problem.measurements.force_N is None:
            raise InputError("the input is no force in newtons; name it as force_N", "physical.force_coordinates")
        inputs = record.u.shape[1]
        if len(p.force_coordinates) != inputs or not all(1 <= c <= coordinates for c in p.force_coordinates):
            raise InputError(
                f"found {p.force_coordinates}; expected one coordinate from 1 to {coordinates} per input ({inputs})",
                "physical.force_coordinates",
            )
        force = np.eye(coordinates)[:, [c - 1 for c in p.force_coordinates]]
    for n, m in enumerate(p.mass):
        if m.coordinate > coordinates:
            raise InputError(f"is {m.coordinate}; the model has {coordinates}", f"physical.mass[{n}].coordinate")
    if force is None and not p.mass:
        return _Structure(form, None, None, None)
    try:
        known = from_known(form, force=force, masses={m.coordinate - 1: m.mass_kg for m in p.mass})
        # with masses alone the force is an estimate, and no force to fit by
        refine = p.refine and force is not None
        fit = output_error(record, known, form=p.form, interrupted=context.interrupted) if refine else None
    except ArgumentError as error:
        raise InputError(str(error), "physical") from error
    best = fit.model if fit else known
    return _Structure(form, known, fit, modes(best.M, best.D, best.K))


def _words(p: Physical | None, model: SubspaceModel, near: str, s: _Structure | None) -> list[str]:
    words = [f"order {model.order}: {model.why}"]
    if near:
        words.append(near)
    words += [
        f"output {k + 1}: held-out samples are predicted {'worse' if fit < 0 else 'little better'} than by their mean "
        f"(fit {fit:.3g} %): the model says little of it; excite more, avoid noise and trends, look at the columns"
        for k, fit in enumerate(model.held_out_fit)
        if fit < POOR
    ]
    if s is None or p is None:
        return words
    if p.mass and s.known is not None and p.refine:
        words.append(
            "known masses start the output-error fit and do not bind it"
            if s.fit
            else "masses alone are known: M, D, K follow from M^-1 K and M^-1 D, without intervals"
        )
    if s.fit is not None:
        e = s.fit.estimate
        for m in p.mass:
            name = f"M[{m.coordinate - 1},{m.coordinate - 1}]"
            low, high = e.interval(name)
            if not low - 0.01 * m.mass_kg <= m.mass_kg <= high + 0.01 * m.mass_kg:
                words.append(
                    f"the mass of coordinate {m.coordinate} is given as {m.mass_kg:g} kg; force and recording say "
                    f"{e.value(name):.5g} ({low:.5g} .. {high:.5g}) kg: one of mass, force and its coordinate is wrong"
                )
    # with M known, that it needs a force or a mass is no news
    words += [w for w in s.form.words if w != near and (s.known is None or w != s.form.words[0])]
    words += [
        *(s.known.words if s.known and not s.fit else ()),
        *(s.modes.words if s.modes else ()),
        *(s.fit.words if s.fit else ()),
    ]
    return words


def _checks(problem: Schema, model: SubspaceModel, best: SecondOrder | None) -> dict[str, Check]:
    radius = float(np.abs(model.poles).max())
    checks = {"largest_pole": at_most(radius, 1.0, "ask for another order")}
    c = problem.synthetic and problem.synthetic.structure
    if c and best is not None:
        error = max(
            float(np.linalg.norm(X - np.array(true)) / np.linalg.norm(true))
            for X, true in ((best.M, c.M_kg), (best.D, c.D_kg_s), (best.K, c.K_N_m))
        )
        checks["matrix_error"] = at_most(error, WITHIN)
    return checks


def _rows(model: SubspaceModel, found: dict[str, Any], s: _Structure | None, best: SecondOrder | None) -> list[Row]:
    rows = [
        Row("order", f"{model.order} ({model.why})"),
        Row("fit on held-out samples", listed(model.held_out_fit), "%"),
        Row("residual, rms", listed(1e6 * model.residual, ".4g"), "um"),
        Row("modes", listed(found["frequency_Hz"]), "Hz"),
        Row("damping", listed(found["damping"], ".4g")),
    ]
    if s is not None:
        rows += [
            Row("M^-1 K", rows_of(s.form.M_inv_K), "1/s2"),
            Row("M^-1 D", rows_of(s.form.M_inv_D), "1/s"),
            Row("velocity jump left in B", s.form.jump),
        ]
    if s and s.fit:
        units = {"M": "kg", "D": "kg/s", "K": "N/m"}
        e = s.fit.estimate
        rows += [Row(n, f"{e.value(n):.6g}{interval(e.interval(n), '.6g')}", units[n[0]]) for n in e.names]
    elif best is not None:
        rows += [
            Row("M", rows_of(best.M), "kg"),
            Row("D", rows_of(best.D), "kg/s"),
            Row("K", rows_of(best.K), "N/m"),
        ]
    rows += [Row("said", w) for w in found["words"][1:]]
    if found["synthetic"]:
        rows.append(Row("SYNTHETIC", found["synthetic"]))
    return rows


def _files(model: SubspaceModel, best: SecondOrder | None, record: Record) -> dict[str, str]:
    comment = f"# synthetic: {record.synthetic}\n" if record.synthetic else ""
    S = model.system
    box = {name: np.asarray(getattr(S, name)).tolist() for name in "ABCD"}
    files = {
        "model.toml": comment
        + "# x[k+1] = A x + B u, y = C x + D u + offset\n"
        + tomli_w.dumps(
            {
                "sample_time_s": record.sample_time,
                **box,
                "initial_state": model.initial_state.tolist(),
                "offset": model.offset.tolist(),
            }
        )
    }
    if best is not None:
        numbers = {"M_kg": best.M.tolist(), "D_kg_s": best.D.tolist(), "K_N_m": best.K.tolist()}
        files["parameters.toml"] = comment + tomli_w.dumps(numbers)
    return files


def _figures(
    problem: Schema, record: Record, model: SubspaceModel, A: np.ndarray, s: _Structure | None
) -> dict[str, Any]:
    def title(what: str) -> str:
        return said(f"{problem.title or 'vibration'}: {what}", record.synthetic)

    def order() -> Any:
        from gtmodel.plot.vibration import order_figure

        trials = [(t.order, t.held_out_rms) for t in model.trials]
        return order_figure(model.singular_values, trials, model.order, title=title("order"))

    def prediction() -> Any:
        from gtmodel.plot.vibration import prediction_figure

        return prediction_figure(
            record.time, record.y, model.prediction, model.first_held_out, model.held_out_fit,
            title=title("prediction of held-out samples"),
        )  # fmt: skip

    def response() -> Any:
        from gtmodel.plot.vibration import response_figure

        S = model.system
        poles = np.linalg.eigvals(A)
        marks = np.unique((np.abs(poles[poles.imag > 0]) / (2 * np.pi)).round(9))
        return response_figure(
            (np.asarray(S.A), np.asarray(S.B), np.asarray(S.C), np.asarray(S.D)), record.sample_time, marks,
            title=title("frequency response"), unit="m/N" if _forced(problem) else "m/m",
        )  # fmt: skip

    return {"order": order, "held_out": prediction, "response": response}


def _forced(problem: Schema) -> bool:
    return problem.synthetic is not None or (
        problem.measurements is not None and problem.measurements.force_N is not None
    )
