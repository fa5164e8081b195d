"""The vibration study: the model of a recording that is asked for, and what it leaves undetermined."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

from ..results import ArgumentError, SolveStatus, Work
from ..results.door import study_function
from ..results.work import Progress, never, silent
from .impulse_study import ImpulseStudy, impulse_study
from .options import Hit, Impulse, Physical, StepResponse, Steps, Subspace, SyntheticStructure
from .record import FitStopped, Record
from .step_study import StepStudy, step_study
from .subspace_study import SubspaceStudy, subspace_study
from .vibration_result import VibrationStudy

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
    title: str = "",
    progress: Progress = silent,
    max_seconds: float | None = None,
    stop: Callable[[], bool] = never,
) -> VibrationStudy:
    """Fit the model asked for to recordings of positions [m].

    Args:
        records: one recording; step responses may be several.
        model: `Subspace` for a state-space model, `StepResponse` for a delayed first-order model, `Impulse` for the
            resonances of a decay.
        physical: what is known beside the recording, which makes M, D, K of a state-space model.
        input_unit: what the inputs are in: "N" for forces, "m" for references.
        truth: the system behind synthetic recordings (`synthetic_records`), to judge the result by.
        progress, max_seconds, stop: see `gtmodel.results.Work`.

    Interrupted, there is no model. Raises ArgumentError.

    >>> from gtmodel.vibration import Hit, Impulse, Sampling, study, synthetic_records
    >>> hit = Hit(frequency=[7.4], damping=[0.03], amplitude=[[5e-4]])
    >>> records = synthetic_records(hit, Sampling(seed=1, noise=1e-6, samples=500))
    >>> round(study(records, Impulse(modes=1), truth=hit).frequency[0], 1)
    7.4
    """
    work = Work(progress=progress, max_seconds=max_seconds, stop=stop)
    given = [records] if isinstance(records, Record) else list(records)
    if physical is not None and not isinstance(model, Subspace):
        raise ArgumentError("goes with a Subspace model", "physical")
    if truth is not None and not isinstance(truth, _KNOWN[type(model)]):
        raise ArgumentError(f"expected {_KNOWN[type(model)].__name__}; found {type(truth).__name__}", "truth")
    if not given or (len(given) > 1 and not isinstance(model, StepResponse)):
        raise ArgumentError(f"found {len(given)} recordings; this model takes one", "records")
    if work.interrupted():
        return _STUDIES[type(model)](
            status=SolveStatus.INTERRUPTED, message="stopped before the fit", title=title
        )  # fmt: skip
    work.progress("fitting", 0.3)
    try:
        if isinstance(model, Subspace):
            return subspace_study(given[0], model, physical, truth, input_unit, title, work.interrupted)  # type: ignore[arg-type]
        if isinstance(model, StepResponse):
            return step_study(given, model, truth, title, work.interrupted)  # type: ignore[arg-type]
        return impulse_study(given[0], model, truth, title, work.interrupted)  # type: ignore[arg-type]
    except FitStopped as stopped:
        return _STUDIES[type(model)](status=SolveStatus.INTERRUPTED, message=str(stopped), title=title)
    except ArgumentError as error:
        raise ArgumentError(error.message, error.argument or "model") from error
