"""Bodies of a serial arm: physically consistent inertias nearest to what was measured, and what an identification
gives besides numbers."""

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
from .recordings import Asked

Array = np.ndarray

WIDTH = 1.0  # of a body, as a share of itself: how far the model is believed where nothing is measured
MOVED = 5.0  # standard deviations: measured numbers that move farther are those of no body
LEAST = 1e-6  # of the other links: mass and size of a body of which the model says nothing
SIZE = 0.1  # m, radius of gyration of such a body
# of the model's body: no body is thinner than this, else round-off decides whether it can exist; a tenth of the
# smallest standard deviation that an estimate counts with
THINNEST = 1e-7
# weights of the barrier: the sum of squares ends within eight times the last one, by links, of its minimum
WEIGHTS = 10.0 ** np.arange(1, -6, -1)
STEPS, STILL = 60, 1e-9  # of Newton's method for each, and the decrement at which it stands
HALVINGS = 60


@dataclass(frozen=True, eq=False)
class ConsistentInertias:
    """Bodies of an arm that can exist: m (n,) [kg], mc (n, 3) [kg m], J (n, 6) [kg m2] as of `SerialArm`.

    `arm` is the arm with them, and with the friction that was estimated. `moved` (base,) says by how many standard
    deviations each base parameter differs from its estimate; where all are small, the estimate was that of bodies.
    """

    arm: SerialArm
    m: Array
    mc: Array
    J: Array
    moved: Array
    notes: tuple[str, ...] = ()


def pseudo_inertia(m: float, mc: Array, J: Array) -> Array:
    """[[tr(J)/2 1 - J, mc], [mc', m]] (4, 4) of mc (3,) and J (6,) about the frame's origin.

    It is positive definite for every body that can exist, and for no other ten numbers (Wensing, Kim, Slotine 2018).

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
    """Bodies that can exist whose base parameters are nearest to an estimate of these, and else nearest to the model's.

    Args:
        arm: with the bodies known before, from a drawing; links without mass get a small body.
        base: the base parameters of the arm.
        estimate: of these, as by `identify`; what it holds at a bound or lacks counts as the model has it.
        width: standard deviation of the model's bodies as a share of themselves, in the metric of their pseudo-inertia.

    Least squares on the cone of positive definite pseudo-inertias P, which is convex: the estimate with its covariance,
    and the bodies' distance from the model's, |P0^(-1/2) (P - P0) P0^(-1/2)| / width, by Newton's method with the
    barrier -log det P, whose weight falls to 1e-5. Raises ModelError for a model's body that cannot exist, and
    ArgumentError for base parameters of another arm, an estimate without any of these or with what is no finite
    number, and a width that is none above zero.

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
    given = np.array([values[name] for name in base.everything])
    bodies = [_columns(base.everything, k) for k in range(n)]
    known = [base.names.index(name) for name in estimate.names if name in base.names]
    names = [base.names[k] for k in known]
    at = [estimate.names.index(name) for name in names]
    for name in base.everything:  # friction and the like keep what was estimated
        if name in names:
            given[base.everything.index(name)] = estimate.value(name)
    K = base.matrix[known]
    target, covariance = estimate.values[at], estimate.covariance[np.ix_(at, at)]
    # noise that numbers of other sizes have as well: a perfect log gives a zero covariance
    floor = 1e-12 * np.maximum(np.abs(target), np.max(np.abs(target), initial=1e-12) * 1e-3) ** 2
    whiten = np.linalg.inv(np.linalg.cholesky(covariance + np.diag(floor)))
    p = _nearest(whiten, K, target, given, bodies, before, width)
    moved = (K @ p - target) / np.sqrt(np.diag(covariance) + floor)
    ten = np.array([p[b] for b in bodies])
    m, mc, J = ten[:, 9], ten[:, 6:9], ten[:, :6]
    more = {name: _whole(name, base.everything, p) for name in _others(base.everything)}
    far = [f"{names[k]} by {abs(moved[k]):.3g}" for k in np.argsort(-np.abs(moved)) if abs(moved[k]) > MOVED]
    if far:
        notes.append(
            f"no bodies have the base parameters that were estimated: consistent ones differ in standard deviations, "
            f"{', '.join(far[:3])}; something acts on the joints that the model lacks"
        )
    consistent = arm.with_(m=m, mc=mc, J=J, **more)
    return ConsistentInertias(consistent, m, mc, J, moved, tuple(notes))


def _refuse(arm: SerialArm, base: BaseRegressor, estimate: Estimate, width: float) -> None:
    if not (np.isfinite(width) and width > 0):
        raise ArgumentError(f"expected a finite number above 0; got {width!r}", "width")
    own = {name for name in base.everything if name.startswith(("J[", "mc[", "m["))}
    if len(own) != 10 * len(arm.structure.joints) or not own <= parameters_of(arm).keys():
        raise ArgumentError(
            f"has {len(own)} numbers of bodies, the arm {10 * len(arm.structure.joints)}; make it of this arm", "base"
        )
    if not set(estimate.names) & set(base.names):
        raise ArgumentError(f"has none of the base parameters, such as '{base.names[0]}'", "estimate")
    if not (np.all(np.isfinite(estimate.values)) and np.all(np.isfinite(estimate.covariance))):
        raise ArgumentError("holds values or a covariance that are no finite numbers", "estimate")


def _nearest(
    whiten: Array, K: Array, target: Array, given: Array, bodies: list[list[int]], before: list[Array], width: float
) -> Array:
    """All parameters with the bodies that minimise |whiten (K p - target)|^2 and their distance from those before.

    Newton's steps are least squares themselves: with P0^(-1/2) P P0^(-1/2) - THINNEST = L L' the barrier's Hessian has
    the root L^-1 B L'^-1, a row for each entry, and its gradient is that root times the unit matrix.
    """
    roots = [np.linalg.inv(np.linalg.cholesky(P)) for P in before]
    basis = [np.array([R @ E @ R.T for E in _BASIS]) for R in roots]
    places = np.concatenate(bodies)
    near = scipy.linalg.block_diag(*[B.reshape(10, 16).T for B in basis]) / width
    A = np.vstack([whiten @ K[:, places], near])
    fixed = given.copy()
    fixed[places] = 0.0
    unit = np.tile(np.eye(4).ravel(), len(before))
    b = np.concatenate([whiten @ (target - K @ fixed), unit / width])
    x = np.concatenate([_ten_of(P) for P in before])

    def factors(x: Array) -> list[Array] | None:
        try:
            return [
                np.linalg.cholesky(np.tensordot(own, B, 1) - THINNEST * np.eye(4))
                for own, B in zip(x.reshape(-1, 10), basis, strict=True)
            ]
        except np.linalg.LinAlgError:
            return None

    def value(x: Array, weight: float, L: list[Array]) -> float:
        return float(0.5 * np.sum((A @ x - b) ** 2) - 2 * weight * sum(np.log(np.diag(one)).sum() for one in L))

    for weight in WEIGHTS:
        for _ in range(STEPS):
            L = factors(x)
            assert L is not None
            inverse = [np.linalg.inv(one) for one in L]
            rows = [np.array([M @ E @ M.T for E in B]).reshape(10, 16).T for M, B in zip(inverse, basis, strict=True)]
            C = np.sqrt(weight) * scipy.linalg.block_diag(*rows)
            stacked, wanted = np.vstack([A, C]), np.concatenate([b - A @ x, np.sqrt(weight) * unit])
            scale = np.linalg.norm(stacked, axis=0)
            step = np.linalg.lstsq(stacked / scale, wanted, rcond=None)[0] / scale
            descent = float(wanted @ (stacked @ step))  # minus the slope along the step, and Newton's decrement
            if descent <= STILL:
                break
            length, now = 1.0, value(x, weight, L)
            for _ in range(HALVINGS):
                there = factors(x + length * step)
                if there is not None and value(x + length * step, weight, there) <= now - 1e-4 * length * descent:
                    break
                length /= 2
            else:
                break
            x = x + length * step
    p = given.copy()
    p[places] = x
    return p


def _columns(names: tuple[str, ...], k: int) -> list[int]:
    own = [*(f"J[{k},{i}]" for i in range(6)), *(f"mc[{k},{i}]" for i in range(3)), f"m[{k}]"]
    return [names.index(name) for name in own]


def _others(names: tuple[str, ...]) -> list[str]:
    return list(dict.fromkeys(n.partition("[")[0] for n in names if n.partition("[")[0] not in ("J", "mc", "m")))


def _whole(name: str, names: tuple[str, ...], p: Array) -> Array | float:
    at = [k for k, n in enumerate(names) if n.partition("[")[0] == name]
    return float(p[at[0]]) if names[at[0]] == name else p[at]


def _bodies_before(arm: SerialArm) -> tuple[list[Array], list[str]]:
    """Pseudo-inertias of the model's bodies, each positive definite, and what had to be assumed."""
    m, mc, J = (np.asarray(x, float) for x in (arm.m, arm.mc, arm.J))
    typical = float(np.max(m)) if np.any(m > 0) else 1.0
    bodies, notes, empty = [], [], []
    for k, joint in enumerate(arm.structure.joints):
        P = pseudo_inertia(float(m[k]), mc[k], J[k])
        if not np.any(P):
            empty.append(joint.link)
            P = typical * (0.1 if np.any(m > 0) else 1.0) * np.diag([SIZE**2, SIZE**2, SIZE**2, 1.0])
        # points and rods are bodies too, at the border: a little thickness
        thin = LEAST * max(float(P[3, 3]), LEAST * typical) * SIZE**2
        P = P + np.diag([thin, thin, thin, 0.0])
        if np.linalg.eigvalsh(P)[0] <= 0:
            raise ModelError(f"the model's body of link '{joint.link}' cannot exist: mass {m[k]:.4g} kg, principal "
                             "moments that no distribution of mass has; give another to start from")  # fmt: skip
        bodies.append(P)
    if empty:
        notes.append(f"the model says nothing of {', '.join(empty)}: a body of {100 * SIZE:g} cm stands in for each")
    return bodies, notes


def _ten_of(P: Array) -> Array:
    """J (6), mc (3), m of a pseudo-inertia, linear in it."""
    S = P[:3, :3]
    return np.array([*six_of(np.trace(S) * np.eye(3) - S), *P[:3, 3], P[3, 3]])


_BASIS = np.array([pseudo_inertia(float(e[9]), e[6:9], e[:6]) for e in np.eye(10)])


URDF, ROBOT = "identified.urdf", "identified.toml"


class IdentifiedBodies(NamedTuple):
    """Quantities of the study, its checks, sentences and files."""

    values: dict[str, Any]
    checks: dict[str, Check]
    notes: list[str]
    files: dict[str, str]


def bodies_of(asked: Asked, identification: Identification) -> IdentifiedBodies:
    """Of a fit of inertias; nothing of any other. Raises ArgumentError where no bodies can be made of it."""
    if not asked.regressor.base:
        return IdentifiedBodies({}, {}, [], {})
    from ..robots import SerialArm, robot_table, to_urdf

    base, robot = asked.regressor, asked.robot
    assert isinstance(base, BaseRegressor) and isinstance(robot, SerialArm)
    values: dict[str, Any] = {"base_parameters": base.combinations}
    if asked.how.inertias != "consistent":
        return IdentifiedBodies(values, {}, [], {})
    try:
        c = consistent_inertias(robot, base, identification.estimate)
    except ModelError as error:
        raise ArgumentError(str(error), "fitting.inertias") from error
    import tomli_w

    source = asked.title or "identification"
    if identification.rows.synthetic:
        source += f"; synthetic data: {identification.rows.synthetic}"
    return IdentifiedBodies(
        values | {"masses": c.m, "first_moments": c.mc, "inertias": c.J},
        {"consistent_bodies_move": at_most(float(np.max(np.abs(c.moved), initial=0.0)), MOVED, "see the notes")},
        [*c.notes, "masses and inertias by themselves are those of the model where the motion determines nothing; "
         "the base parameters alone are measured"],
        {URDF: to_urdf(c.arm, source), ROBOT: tomli_w.dumps({"source": source, **robot_table(c.arm, URDF)})},
    )  # fmt: skip
