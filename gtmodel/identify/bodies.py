"""Bodies of a serial arm: the physically consistent inertias nearest to an estimate, with checks, notes and files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy

from ..lang import ModelError
from ..results import Check, at_most
from ..results.estimate import Estimate
from ..results.refusal import ArgumentError
from ..robots import SerialArm
from ..robots.serial.structure import six_of, tensor
from .base_parameters import BaseRegressor, parameters_of
from .inertia import Identification
from .recordings import Request

Array = np.ndarray

WIDTH = 1.0  # relative standard deviation of the model's bodies where nothing is measured
MOVED = 5.0  # standard deviations: no body explains an estimate that has to move farther
LEAST = 1e-6  # relative to the other links: mass and size of a link without data in the model
SIZE = 0.1  # m, radius of gyration of such a link
# relative to the model's body: lower bound on the pseudo-inertia, so that round-off does not decide consistency; a
# tenth of the smallest standard deviation that an estimate counts with
THINNEST = 1e-7
# weights of the barrier: the final sum of squares is within eight times the last weight, per link, of the minimum
WEIGHTS = 10.0 ** np.arange(1, -6, -1)
STEPS, STILL = 60, 1e-9  # Newton steps for each weight, and the Newton decrement at convergence
HALVINGS = 60


@dataclass(frozen=True, eq=False)
class ConsistentInertias:
    """Physically consistent bodies of an arm: m (n,) [kg], mc (n, 3) [kg m], J (n, 6) [kg m2] as in `SerialArm`.

    `arm` is the arm with these bodies and the estimated friction. `moved` (base,) is the distance of each base
    parameter from its estimate in standard deviations. If all are small, the estimate was physically consistent.
    """

    arm: SerialArm
    m: Array
    mc: Array
    J: Array
    moved: Array
    notes: tuple[str, ...] = ()


def pseudo_inertia(m: float, mc: Array, J: Array) -> Array:
    """Return [[tr(J)/2 1 - J, mc], [mc', m]] (4, 4) for mc (3,) and J (6,) about the frame's origin.

    It is positive definite if and only if a body can have these ten numbers (Wensing, Kim, Slotine 2018).

    >>> gt.identify.pseudo_inertia(2.0, np.zeros(3), np.array([0.3, 0, 0, 0.3, 0, 0.4])).diagonal().round(3)
    array([0.2, 0.2, 0.1, 2. ])
    """
    I = tensor(J)
    P = np.zeros((4, 4))
    P[:3, :3] = np.trace(I) / 2 * np.eye(3) - I
    P[:3, 3] = P[3, :3] = mc
    P[3, 3] = m
    return P


def consistent_inertias(
    arm: SerialArm, base: BaseRegressor, estimate: Estimate, *, width: float = WIDTH
) -> ConsistentInertias:
    """Return the physically consistent bodies nearest to estimated base parameters; the model's bodies fill the rest.

    Args:
        arm: the arm with prior bodies, such as from a drawing; links without mass get a small body.
        base: the base parameters of the arm.
        estimate: estimated base parameters, as from `identify`; others keep the model's values.
        width: standard deviation of the model's bodies relative to themselves, in the metric of their pseudo-inertia,
            and of a rotor inertia that only occurs in a sum with them; if the model's is 0, relative to the largest
            one that is estimated.

    A convex least-squares problem on the cone of positive definite pseudo-inertias P: the estimate weighted by its
    covariance, plus the distance from the model's bodies, |P0^(-1/2) (P - P0) P0^(-1/2)| / width. Newton's method
    solves it with the barrier -log det P, whose weight falls to 1e-5. Raises ModelError if a body of the model is not
    consistent; ArgumentError if `base` belongs to another arm, if the estimate has no base parameter or a value that is
    not finite, or if `width` is not finite and positive.

    >>> arm = gt.robots.serial_arm(a=[0.5], alpha=0.0, base_rpy=[np.pi / 2, 0, 0], m=[2.0], c=[[-0.25, 0, 0]],
    ...                            I=[np.diag([0.01, 0.04, 0.04])])
    >>> base = gt.identify.BaseRegressor(arm)
    >>> measured = 1.2 * base.nominal  # all a fifth more than the model says
    >>> e = gt.inference.linear_fit(np.eye(3), measured, base.names, sigma=1e-3)
    >>> c = gt.identify.consistent_inertias(arm, base, e)
    >>> bool(np.abs(c.moved).max() < 0.1), bool(2.0 < c.m[0] < 2.8)
    (True, True)
    """
    n = len(arm.structure.joints)
    _refuse(arm, base, estimate, width)
    before, notes = _bodies_before(arm)
    values = parameters_of(arm)
    values_of_model = np.array([values[name] for name in base.everything])
    bodies = [_columns(base.everything, k) for k in range(n)]
    known = [base.names.index(name) for name in estimate.names if name in base.names]
    names = [base.names[k] for k in known]
    rows = [estimate.names.index(name) for name in names]
    for name in base.everything:  # friction and other free parameters take their estimates
        if name in names:
            values_of_model[base.everything.index(name)] = estimate.value(name)
    K = base.matrix[known]
    target, covariance = estimate.values[rows], estimate.covariance[np.ix_(rows, rows)]
    # floor, relative to the numbers: a perfect log gives a zero covariance
    floor = 1e-12 * np.maximum(np.abs(target), np.max(np.abs(target), initial=1e-12) * 1e-3) ** 2
    whiten = np.linalg.inv(np.linalg.cholesky(covariance + np.diag(floor)))
    others, sizes = _shared(base, K, values_of_model, bodies, estimate)
    p = _nearest(whiten, K, target, values_of_model, bodies, before, others, sizes, width)
    moved = (K @ p - target) / np.sqrt(np.diag(covariance) + floor)
    ten = np.array([p[b] for b in bodies])
    m, mc, J = ten[:, 9], ten[:, 6:9], ten[:, :6]
    more = {name: _whole(name, base.everything, p) for name in _others(base.everything)}
    if others:
        taken = ", ".join(f"{base.everything[k]} = {p[k]:.3g}" for k in others)
        notes.append(f"determined only in a sum with inertias of the links, and chosen with them: {taken}")
    far = [f"{names[k]} by {abs(moved[k]):.3g}" for k in np.argsort(-np.abs(moved)) if abs(moved[k]) > MOVED]
    if far:
        notes.append(
            "the estimated base parameters are not those of physical bodies: consistent bodies differ, in standard "
            f"deviations, {', '.join(far[:3])}; the model lacks something that acts on the joints"
        )
    consistent = arm.with_(m=m, mc=mc, J=J, **more)
    return ConsistentInertias(consistent, m, mc, J, moved, tuple(notes))


def _refuse(arm: SerialArm, base: BaseRegressor, estimate: Estimate, width: float) -> None:
    if not (np.isfinite(width) and width > 0):
        raise ArgumentError(f"expected a finite number above 0; got {width!r}", "width")
    numbers = {name for name in base.everything if name.startswith(("J[", "mc[", "m["))}
    if len(numbers) != 10 * len(arm.structure.joints) or not numbers <= parameters_of(arm).keys():
        raise ArgumentError(
            f"has {len(numbers)} body parameters; the arm has {10 * len(arm.structure.joints)}: make it of this arm",
            "base",
        )
    if not set(estimate.names) & set(base.names):
        raise ArgumentError(f"has no base parameter; expected names such as '{base.names[0]}'", "estimate")
    if not (np.all(np.isfinite(estimate.values)) and np.all(np.isfinite(estimate.covariance))):
        raise ArgumentError("has values or covariances that are not finite", "estimate")


def _shared(
    base: BaseRegressor, K: Array, values: Array, bodies: list[list[int]], estimate: Estimate
) -> tuple[list[int], Array]:
    """Places and sizes of the further parameters, such as rotor inertias, that occur only in sums with bodies."""
    inside = {k for b in bodies for k in b}
    places = [k for k, n in enumerate(base.everything)
              if k not in inside and n not in estimate.names and np.any(K[:, k])]  # fmt: skip
    sizes = []
    for k in places:
        array = base.everything[k].partition("[")[0]
        alike = [
            abs(estimate.value(n)) for n in estimate.names if n in base.everything and n.partition("[")[0] == array
        ]
        sizes.append(abs(values[k]) or max(alike, default=0.0) or float(np.max(np.abs(base.nominal), initial=1e-3)))
    return places, np.array(sizes)


def _nearest(
    whiten: Array, K: Array, target: Array, nominal: Array, bodies: list[list[int]], before: list[Array],
    others: list[int], sizes: Array, width: float,
) -> Array:  # fmt: skip
    """All parameters, with the bodies that minimise |whiten (K p - target)|^2 plus their distance from those before.

    The parameters at `others`, with these sizes, are positive and count in the same way. Each Newton step is a
    least-squares problem: with P0^(-1/2) P P0^(-1/2) - THINNEST = L L' the barrier's Hessian has the root
    L^-1 B L'^-1, one row per entry, and its gradient is that root times the unit matrix.
    """
    roots = [np.linalg.inv(np.linalg.cholesky(P)) for P in before]
    basis = [np.array([R @ E @ R.T for E in _BASIS]) for R in roots]
    places = np.concatenate([*bodies, np.array(others, int)])
    count = 10 * len(bodies)
    near = scipy.linalg.block_diag(*[B.reshape(10, 16).T for B in basis], np.diag(1 / sizes)) / width
    A = np.vstack([whiten @ K[:, places], near])
    fixed = nominal.copy()
    fixed[places] = 0.0
    unit = np.tile(np.eye(4).ravel(), len(before))
    b = np.concatenate([whiten @ (target - K @ fixed), unit / width, nominal[others] / sizes / width])
    x = np.concatenate([*[_ten_of(P) for P in before], np.where(nominal[others] > 0, nominal[others], sizes)])
    inward = np.concatenate([unit, np.ones(len(others))])

    def factors(x: Array) -> list[Array] | None:
        if np.any(x[count:] <= 0):
            return None
        try:
            return [
                np.linalg.cholesky(np.tensordot(body, B, 1) - THINNEST * np.eye(4))
                for body, B in zip(x[:count].reshape(-1, 10), basis, strict=True)
            ]
        except np.linalg.LinAlgError:
            return None

    def value(x: Array, weight: float, L: list[Array]) -> float:
        logarithms = 2 * sum(np.log(np.diag(factor)).sum() for factor in L) + np.log(x[count:]).sum()
        return float(0.5 * np.sum((A @ x - b) ** 2) - weight * logarithms)

    for weight in WEIGHTS:
        for _ in range(STEPS):
            L = factors(x)
            assert L is not None
            inverse = [np.linalg.inv(factor) for factor in L]
            rows = [np.array([M @ E @ M.T for E in B]).reshape(10, 16).T for M, B in zip(inverse, basis, strict=True)]
            C = np.sqrt(weight) * scipy.linalg.block_diag(*rows, np.diag(1 / x[count:]))
            stacked, right = np.vstack([A, C]), np.concatenate([b - A @ x, np.sqrt(weight) * inward])
            scale = np.linalg.norm(stacked, axis=0)
            step = np.linalg.lstsq(stacked / scale, right, rcond=None)[0] / scale
            descent = float(right @ (stacked @ step))  # minus the slope along the step: the Newton decrement
            if descent <= STILL:
                break
            length, current = 1.0, value(x, weight, L)
            for _ in range(HALVINGS):
                trial = factors(x + length * step)
                if trial is not None and value(x + length * step, weight, trial) <= current - 1e-4 * length * descent:
                    break
                length /= 2
            else:
                break
            x = x + length * step
    p = nominal.copy()
    p[places] = x
    return p


def _columns(names: tuple[str, ...], k: int) -> list[int]:
    body = [*(f"J[{k},{i}]" for i in range(6)), *(f"mc[{k},{i}]" for i in range(3)), f"m[{k}]"]
    return [names.index(name) for name in body]


def _others(names: tuple[str, ...]) -> list[str]:
    return list(dict.fromkeys(n.partition("[")[0] for n in names if n.partition("[")[0] not in ("J", "mc", "m")))


def _whole(name: str, names: tuple[str, ...], p: Array) -> Array | float:
    places = [k for k, n in enumerate(names) if n.partition("[")[0] == name]
    return float(p[places[0]]) if names[places[0]] == name else p[places]


def _bodies_before(arm: SerialArm) -> tuple[list[Array], list[str]]:
    """Pseudo-inertias of the model's bodies, all positive definite, and notes on assumptions."""
    m, mc, J = (np.asarray(x, float) for x in (arm.m, arm.mc, arm.J))
    typical = float(np.max(m)) if np.any(m > 0) else 1.0
    bodies, notes, empty = [], [], []
    for k, joint in enumerate(arm.structure.joints):
        P = pseudo_inertia(float(m[k]), mc[k], J[k])
        if not np.any(P):
            empty.append(joint.link)
            P = typical * (0.1 if np.any(m > 0) else 1.0) * np.diag([SIZE**2, SIZE**2, SIZE**2, 1.0])
        # points and rods are on the border of the cone: add a little thickness
        thin = LEAST * max(float(P[3, 3]), LEAST * typical) * SIZE**2
        P = P + np.diag([thin, thin, thin, 0.0])
        if np.linalg.eigvalsh(P)[0] <= 0:
            raise ModelError(f"the body of link '{joint.link}' in the model is not physical: mass {m[k]:.4g} kg, and "
                             "no mass distribution has its principal moments; start from another body")  # fmt: skip
        bodies.append(P)
    if empty:
        notes.append(f"the model has no inertia for {', '.join(empty)}: assumed a body of {100 * SIZE:g} cm for each")
    return bodies, notes


def _ten_of(P: Array) -> Array:
    """J (6), mc (3) and m of a pseudo-inertia, linear in it."""
    S = P[:3, :3]
    return np.array([*six_of(np.trace(S) * np.eye(3) - S), *P[:3, 3], P[3, 3]])


_BASIS = np.array([pseudo_inertia(float(e[9]), e[6:9], e[:6]) for e in np.eye(10)])


URDF, ROBOT = "identified.urdf", "identified.toml"


class IdentifiedBodies(NamedTuple):
    """Quantities, checks, notes and files of the study."""

    values: dict[str, Any]
    checks: dict[str, Check]
    notes: list[str]
    files: dict[str, str]


def bodies_of(request: Request, identification: Identification) -> IdentifiedBodies:
    """The bodies of a fit of inertias; empty for another fit. Raises ArgumentError if a body of the model is wrong."""
    if not request.regressor.base:
        return IdentifiedBodies({}, {}, [], {})
    from ..robots import SerialArm, robot_table, to_urdf

    base, robot = request.regressor, request.robot
    assert isinstance(base, BaseRegressor) and isinstance(robot, SerialArm)
    values: dict[str, Any] = {"base_parameters": base.combinations}
    if request.how.inertias != "consistent":
        return IdentifiedBodies(values, {}, base.notes, {})
    try:
        c = consistent_inertias(robot, base, identification.estimate)
    except ModelError as error:
        raise ArgumentError(str(error), "fitting.inertias") from error
    import tomli_w

    source = request.title or "identification"
    if identification.rows.synthetic:
        source += f"; synthetic data: {identification.rows.synthetic}"
    return IdentifiedBodies(
        values | {"masses": c.m, "first_moments": c.mc, "inertias": c.J},
        {"consistent_bodies_move": at_most(float(np.max(np.abs(c.moved), initial=0.0)), MOVED, "see the notes")},
        [*base.notes, *c.notes, "where the motion determines nothing, individual masses and inertias are those of the "
         "model; only the base parameters are measured"],
        {URDF: to_urdf(c.arm, source), ROBOT: tomli_w.dumps({"source": source, **robot_table(c.arm, URDF)})},
    )  # fmt: skip
