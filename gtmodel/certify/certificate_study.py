"""The study of a certificate: what holds at every point of a box, proved by interval arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, Literal, Unpack

import numpy as np

from ..cgen.interface import box_of, check_names
from ..cgen.real import real_of
from ..compiler.causal import CausalFunction
from ..results import ArgumentError, SolveStatus, Work, at_least
from ..results.options import Within
from ..results.table import csv_text
from ..results.work import WorkOptions, study_function
from .certificate import PROVED, REFUTED, UNDECIDED, WORDS, BoxCertificate, InputSpeed
from .claims import REGULAR, SOLVED, STATUS, Claim, bound_claims, entries
from .closed_form import ClosedFormProver
from .intervals import LIBM_ULP, Array
from .newton_form import ANSWER, NewtonProver
from .subdivision import Leaves, least_singular, subdivide

ASSUMPTIONS = (
    "IEEE 754 arithmetic, rounded to nearest, with denormal numbers: no -ffast-math, no flush to zero, no contraction "
    "(-ffp-contract=off), no extended registers",
    f"sin, cos, tan, asin, acos, atan, atan2, exp, log, pow, sinh, cosh, tanh of libm and NumPy within {LIBM_ULP:g} "
    "units in the last place",
    "the constants of the generated text are exact; how well they describe the machine is another question",
    "inputs are exact: the box holds the numbers that the function is given",
)
PROVED_ALL = "proved at every point of the box"
RESOLUTION = 0.01  # of the size of the largest box
SHARPENING = 200  # boxes spent on a sharper bound of the smallest singular value


@study_function
def study(
    function: CausalFunction,
    box: Mapping[str, Sequence[Sequence[float]]],
    *,
    bounds: Mapping[str, Sequence[Sequence[float]]] | None = None,
    regular: bool = False,
    moving: InputSpeed | None = None,
    around: Mapping[str, Sequence[float] | float] | None = None,
    real: Literal["double", "float"] = "double",
    max_boxes: Annotated[int, Within(least=1)] = 100_000,
    cuts: str = "",
    **work_options: Unpack[WorkOptions],
) -> BoxCertificate:
    """Prove that a function has a solution at every point of a box, and bound the errors of its code there.

    Args:
        function: a closed form, or a function with one Newton block.
        box: intervals by name of every input, such as {"T": [[0, 0.8], [-1, -0.6], [0, 0.5]]}; one for each number, or
            one for all.
        bounds: intervals in which outputs must stay, by name, such as strokes {"q": [[-2.0, 0.0]]}.
        regular: also prove that the Jacobian of the outputs by the inputs has full rank, so that no pose inside is
            singular; for an arm, give all targets of the pose, such as T and R.
        moving: for a Newton block: prove also that the code in C, started at its last answer, returns GT_OK and the
            solution up to round-off. Without it, errors are bounded by the tolerance of the code.
        around: a point inside the box, by name of every input: shrink the box towards it until all is proved, and
            return the largest one, to 1 % of the size of `box`.
        real: number type of the code whose status is proved.
        max_boxes: largest number of boxes to examine.
        cuts: `cuts` of an earlier result of the same proof that was stopped, to continue it: the boxes that it kept are
            judged again, not those that it halved.
        title, progress, max_seconds, stop, workers, executor: see `gtmodel.results.Work`.

    The status is CHECK_FAILED unless all is proved in the whole box. What was refuted is named with a point that was
    evaluated; what stays open is undecided, with its share of the volume. Nothing rests on samples. Raises
    ArgumentError, for example for an operation without an interval extension.

    >>> ik = gt.robots.gantry_tau("l1_tape").causal(known="T", targets="q")
    >>> s = gt.certify.study(ik, {"T": [[0.0, 0.8], [-1.1, -0.7], [0.05, 0.55]]}, regular=True)
    >>> s.proved, s.claims["status OK"]
    (1.0, 'proved')
    >>> s.errors["q[0]"] < 2e-15  # m, round-off of the computed position anywhere in the box
    True
    """
    work = Work(**work_options)
    lo, hi = _box(function, box)
    claims = bound_claims(function, bounds or {})
    prover: ClosedFormProver | NewtonProver
    if function.kernels:
        if real != "double":
            raise ArgumentError(
                f"{function.name} uses Newton's method, which is certified in double only; leave out real", "real"
            )
        prover = NewtonProver(function, claims, None if moving is None else _away(function, moving), regular)
    else:
        if moving is not None:
            raise ArgumentError(f"{function.name} is a closed form, which has no last answer; leave it out", "moving")
        prover = ClosedFormProver(function, claims, regular, real_of(real))

    def going(share: float, boxes: int) -> bool:
        work.progress("cutting boxes", share, {"boxes": boxes})
        return not work.interrupted()

    if around is None:
        leaves = subdivide(prover, lo, hi, max_boxes, going, cuts=cuts)
        return _study_of(prover, leaves, lo, hi, work, None)
    if cuts:
        raise ArgumentError("the search for the largest box begins anew; leave out the earlier result", "cuts")
    centre = _point(function, around, lo, hi)
    leaves, scale = _largest(prover, centre, lo, hi, max_boxes, going)
    return _study_of(prover, leaves, centre + scale * (lo - centre), centre + scale * (hi - centre), work, scale)


def _point(function: CausalFunction, around: Mapping[str, Sequence[float] | float], lo: Array, hi: Array) -> Array:
    """Return the point to which the box shrinks. Raises ArgumentError."""
    names = [s.name for s in function.inputs]
    values = np.concatenate([np.ravel(around[n]) for n in names]) if set(around) == set(names) else np.zeros(0)
    if values.shape != lo.shape or not np.all((values >= lo) & (values <= hi)):
        raise ArgumentError(f"give a point inside the box, by name of each of {', '.join(names)}", "around")
    return values.astype(float)


def _largest(
    prover: ClosedFormProver | NewtonProver, centre: Array, lo: Array, hi: Array, max_boxes: int,
    going: Callable[[float, int], bool],
) -> tuple[Leaves, float]:  # fmt: skip
    """Return the leaves of the largest proved box that shrinks towards a point, and its size relative to the whole; of
    the smallest one that was tried, if none is proved."""
    proved, scale, open_ = 0.0, 1.0, 1.0
    best: Leaves | None = None
    while True:
        box = centre + scale * (lo - centre), centre + scale * (hi - centre)
        leaves = subdivide(prover, *box, max_boxes, going, whole=True)
        if leaves.volume(PROVED) == 1.0:
            proved, best = scale, leaves
        else:
            open_ = scale
        if open_ - proved <= RESOLUTION or proved == 1.0 or not leaves.complete:
            return (leaves, scale) if best is None else (best, proved)
        scale = 0.5 * (proved + open_)


def _away(function: CausalFunction, moving: InputSpeed) -> Array:
    """Return how far each input moves in a period. Raises ArgumentError."""
    names = [s.name for s in function.inputs]
    if set(moving.speed) != set(names) or not all(0 <= v < np.inf for v in moving.speed.values()):
        raise ArgumentError(f"give a speed of at least zero for each of {', '.join(names)}", "moving.speed")
    return np.array([moving.speed[s.name] * moving.period for s in function.inputs for _ in range(s.size)])


def _box(function: CausalFunction, box: Mapping[str, Sequence[Sequence[float]]]) -> tuple[Array, Array]:
    """Return the corners (inputs,) of the box. Raises ArgumentError."""
    check_names({function.name: function}, box)
    intervals = box_of(function, box)
    if intervals is None:
        if function.plan.uses_time:
            raise ArgumentError(f"{function.name} depends on the time, which no box bounds", "function")
        lacking = ", ".join(s.name for s in function.inputs if s.name not in box)
        raise ArgumentError(f"the box gives no interval for {lacking}", "box")
    if not intervals:
        raise ArgumentError(f"{function.name} has no inputs, so there is no box; call it", "function")
    lo, hi = np.array(intervals).T
    with np.errstate(over="ignore"):
        if not np.all(np.isfinite(hi - lo)):
            raise ArgumentError("expected intervals whose width is a number; give a smaller box", "box")
    return lo, hi


def _study_of(
    prover: ClosedFormProver | NewtonProver, leaves: Leaves, lo: Array, hi: Array, work: Work, scale: float | None
) -> BoxCertificate:
    verdicts, function = leaves.verdicts, prover.function
    good = verdicts == PROVED
    names, targets = entries(function.inputs), entries(function.outputs)
    errors, single, ranges = _bounds(prover, leaves, good, hi > lo)
    volumes = {v: leaves.volume(v) for v in WORDS}
    turned = _opposite(prover, leaves) if isinstance(prover, ClosedFormProver) and prover.regular else None
    claims, points = _claims(prover, leaves, names, turned)
    least = steps = None
    if isinstance(prover, NewtonProver):
        steps = int(leaves.worst[-2, good].max()) if prover.away is not None and good.any() else None
    if prover.regular and good.any():
        least = least_singular(prover, leaves, good, SHARPENING)
    open_ = next((f"{name}: {word}" for name, word in [*claims.items()][1:] if word != WORDS[PROVED]), "")
    advice = f"{open_}; use a smaller box" + ("" if points else ", or a larger max_boxes")
    stopped = not leaves.complete
    return BoxCertificate(
        status=SolveStatus.INTERRUPTED if stopped else SolveStatus.SOLVED,
        message=f"stopped with {100 * volumes[UNDECIDED]:.3g} % of the volume undecided" if stopped else PROVED_ALL,
        title=work.title,
        checks={"proved": at_least(volumes[PROVED], 1.0, advice)},
        proved=volumes[PROVED], refuted=volumes[REFUTED], undecided=volumes[UNDECIDED], boxes=leaves.examined,
        claims=claims, counter_examples=points,
        errors=dict(zip(targets, errors, strict=True)), float_errors=dict(zip(targets, single, strict=True)),
        ranges=dict(zip(targets, ranges, strict=True)), least_singular_value=least, steps=steps, scale=scale,
        cuts=leaves.cuts, notes=_notes(prover),
        box={n: [float(a), float(b)] for n, a, b in zip(names, lo, hi, strict=True)},
        real=prover.real.name, assumptions=ASSUMPTIONS,
        figures={"boxes": partial(_figure, function, leaves, volumes, lo, hi, points, work.title)},
        files={"boxes.csv": _table(prover.claims, leaves, names)},
    )  # fmt: skip


def _notes(prover: ClosedFormProver | NewtonProver) -> list[str]:
    if not isinstance(prover, NewtonProver):
        return []
    if prover.away is not None:
        return ["errors are those of round-off, for code that starts at its last answer"]
    return [
        f"errors are bounded by the tolerance of the code, for an answer within {ANSWER:g} nominals of the solution; "
        "with the motion of the inputs, moving, by round-off"
    ]


def _bounds(
    prover: ClosedFormProver | NewtonProver, leaves: Leaves, good: Array, wide: Array
) -> tuple[list[Any], list[Any], list[Any]]:
    """Return error bounds in double and in float, and ranges of the outputs, over the proved boxes; None if unknown."""
    if not good.any():
        none = [None] * prover.targets
        return none, none, none
    double, single, high, low = prover.bounds(leaves, good, wide)
    errors, singles = ([float(x) if np.isfinite(x) else None for x in row] for row in (double, single))
    pairs = [
        [float(-a), float(b)] if np.isfinite(a) and np.isfinite(b) else None for a, b in zip(low, high, strict=True)
    ]
    return errors, singles, pairs


def _claims(
    prover: ClosedFormProver | NewtonProver, leaves: Leaves, names: Sequence[str], turned: tuple[Array, Array] | None
) -> tuple[dict[str, str], list[dict[str, Any]]]:
    """Return the verdict of each claim in words, first those of the status together, and the counter-examples."""
    words: dict[str, str] = {}
    points: list[dict[str, Any]] = []
    together = np.array([c.kind in (STATUS, SOLVED) for c in prover.claims])
    refuted_status = False
    for k, claim in enumerate(prover.claims):
        states, point = leaves.states[k], leaves.violated[k]
        refuted = point is not None or bool((states < 0).any())
        refuted_status |= refuted and bool(together[k])
        name, copies = claim.name, 1
        while name in words:  # margins may share a label
            copies += 1
            name = f"{claim.name} ({copies})"
        if claim.kind == REGULAR and turned is not None and not refuted:
            signs = f"its determinant has opposite signs at {_at(names, turned[0])} and {_at(names, turned[1])}"
            words[name] = f"{WORDS[REFUTED]}: {signs}"
        else:
            words[name] = _word(refuted, states > 0, leaves.share)
        if point is not None:
            words[name] += f" at {_at(names, point)}"
            points.append({"claim": name, "point": dict(zip(names, point.tolist(), strict=True))})
    summary = _word(refuted_status, np.asarray((leaves.states[together] > 0).all(axis=0)), leaves.share)
    # without a motion nothing is said about the start of Newton's method
    where = " at the solution" if isinstance(prover, NewtonProver) and prover.away is None else ""
    return {f"status OK{where}": summary, **words}, points


def _word(refuted: bool, good: Array, share: Array) -> str:
    """Return the verdict in words of a claim that is proved in the `good` boxes."""
    if refuted:
        return WORDS[REFUTED]
    return WORDS[PROVED] if good.all() else f"{WORDS[UNDECIDED]} in {100 * share[~good].sum():.3g} % of the volume"


def _at(names: Sequence[str], point: Array) -> str:
    # all digits of a number that has more than six: the point before it may be a good one
    texts = [short if float(short := f"{x:.6g}") == x else repr(float(x)) for x in point]
    return "(" + ", ".join(f"{n} = {x}" for n, x in zip(names, texts, strict=True)) + ")"


def _opposite(prover: ClosedFormProver, leaves: Leaves) -> tuple[Array, Array] | None:
    """Return two points at which the determinant of the Jacobian has opposite signs, both certain, or None. The status
    is OK everywhere and nothing jumps, so the determinant has a zero between them."""
    rows = [k for k, c in enumerate(prover.claims) if c.kind == STATUS]
    if not (leaves.states[rows] > 0).all() or not prover.continuous(leaves.lo, leaves.hi):
        return None
    middle = 0.5 * (leaves.lo + leaves.hi)
    signs = prover.sign(middle)
    ends = [np.flatnonzero(signs == s) for s in (1.0, -1.0)]
    return None if not all(e.size for e in ends) else (middle[:, ends[0][0]], middle[:, ends[1][0]])


def _table(claims: Sequence[Claim], leaves: Leaves, names: Sequence[str]) -> str:
    """boxes.csv: the corners with all digits, the verdict, and the first claim that is not proved."""
    columns: dict[str, Any] = {}
    for k, name in enumerate(names):
        columns[f"{name}_low"], columns[f"{name}_high"] = leaves.lo[k], leaves.hi[k]
    columns["verdict"] = [WORDS[int(v)] for v in leaves.verdicts]
    open_ = leaves.states <= 0
    columns["open_claim"] = [claims[int(np.argmax(o))].name if o.any() else "" for o in open_.T]
    return csv_text(columns, 17)


def _figure(
    function: CausalFunction,
    leaves: Leaves,
    volumes: dict[int, float],
    lo: Array,
    hi: Array,
    points: list[dict[str, Any]],
    title: str,
) -> Any:
    from ..plot.certificate import boxes_figure

    names = entries(function.inputs)
    units = [s.unit for s in function.inputs for _ in range(s.size)]
    cuts = [len(np.unique(row)) if b > a else 0 for row, a, b in zip(leaves.lo, lo, hi, strict=True)]
    order = sorted(range(len(lo)), key=lambda k: (-cuts[k], k))[:2]
    pair = sorted(order) if len(order) == 2 else [order[0], order[0]]
    places = np.array([[p["point"][names[k]] for p in points] for k in pair]).reshape(2, -1)
    first, second = (f"{names[k]} [{units[k]}]" for k in pair)
    return boxes_figure(
        leaves.lo[pair], leaves.hi[pair], leaves.verdicts, volumes, names=(first, second), points=places,
        title=title or function.name,
    )  # fmt: skip
