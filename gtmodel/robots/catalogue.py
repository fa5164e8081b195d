"""The catalogue: robots by name, built from the printed parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._near import meant
from ..lang import Model, ModelError
from ..mechanics import PiecewiseLinearFriction, SignFriction, StictionFriction, TanhFriction
from . import links
from .entries import entries, family_in, geometries, printed
from .three_link import GantryTau

SMOOTHINGS = {
    "tanh": TanhFriction,
    "piecewise_linear": PiecewiseLinearFriction,
    "sign": SignFriction,
    "stiction": StictionFriction,
}
VELOCITY_SCALE = 0.1  # friction smoothing [m/s]


def dynamics_table() -> dict[str, Any]:
    """Return the printed dynamics and friction of the L1 (Dressler 2012, chapters 3, 6 and 7)."""
    return printed("gantry_tau_dynamics.toml")


def _sets() -> dict[str, dict[str, Any]]:
    """Return the three-link geometries by name."""
    return {name: table for name, table in geometries().items() if family_in(table) == "three_link"}


def _inertias() -> dict[str, dict[str, Any]]:
    """Return the identified inertia models whose friction is symmetric and printed in full."""
    table = dynamics_table()["inertia"]
    return {k: v for k, v in table.items() if "*" not in (v["coulomb_N"], v["viscous_kg_s"])}


def inertia_names() -> list[str]:
    """Return the names of the identified inertia and friction models (Dressler 2012, Table 6.3).

    >>> gt.robots.inertia_names()
    ['model_1', 'model_2']
    """
    return sorted(_inertias())


def make(name: str, **options: Any) -> Model:
    """Return a robot of the catalogue, of any family, with the defaults of its family.

    options: parameters of the model, and payload [kg], smoothing, velocity_scale [m/s] and, for three links, inertia as
    in `gantry_tau`. Raises ModelError for an unknown name, a payload below 0, and options that the family does not
    take.

    >>> robot = gt.robots.make("f1", payload=2.0)
    >>> print(type(robot).__name__, robot.m_p)
    F1 14.0
    >>> gt.robots.make("l1_tap")
    Traceback (most recent call last):
        ...
    gtmodel.lang.source.ModelError: there is no robot 'l1_tap'; did you mean 'l1_tape' or 'l1_tracker'?
    """
    return family_member(_pick(name, entries(), "robot").family, name, **options)


def family_member(
    family: str,
    name: str | None = None,
    *,
    inertia: str | None = None,
    smoothing: str = "tanh",
    velocity_scale: float = VELOCITY_SCALE,
    payload: float = 0.0,
    **modifiers: Any,
) -> Model:
    """Return the named robot of a family; without a name, `modifiers` must give the whole geometry."""
    if family == "serial" and name is None:
        from .serial.dh import serial_arm  # imported here, as below: one robot does not need the other families

        if inertia is not None:
            raise ModelError(
                f"inertia model '{inertia}' applies to three-link robots only; give the masses of the links"
            )
        return serial_arm(smoothing=smoothing, velocity_scale=velocity_scale, payload=payload, **modifiers)
    if family == "serial":
        if inertia is not None or payload or smoothing != "tanh" or velocity_scale != VELOCITY_SCALE:
            raise ModelError(
                "masses and friction of 'kr500' are not printed; leave out inertia, payload and friction smoothing"
            )
        from .kuka import kr500

        return kr500(**modifiers)
    if family == "three_link":
        masses = {} if inertia is None else {"inertia": inertia}
        return gantry_tau(
            name or "l1_tape",
            smoothing=smoothing,
            velocity_scale=velocity_scale,
            payload=payload,
            **masses,
            **modifiers,
        )
    maker, default, example = _maker(family)
    if inertia is not None:
        raise ModelError(
            f"inertia model '{inertia}' applies to three-link robots only; give the masses of '{name or default}' as "
            f"parameters: {', '.join(k for k in example if k.startswith(('m_', 'I_', 'J')))}"
        )
    friction = _pick(smoothing, SMOOTHINGS, "friction smoothing")
    cart = _with_parts({"friction": friction}, modifiers.pop("cart", {}))
    m_p = _loaded(modifiers.pop("m_p", example["m_p"]), payload)
    return maker(name or default, **{"m_p": m_p, "velocity_scale": velocity_scale, "cart": cart, **modifiers})


def _maker(family: str) -> tuple[Callable[..., Model], str, dict[str, Any]]:
    """Return the factory of a family with six links, its default robot, and the example masses."""
    if family == "f1":
        from .f1 import EXAMPLE as F1_EXAMPLE, f1_gantry_tau

        return f1_gantry_tau, "f1", F1_EXAMPLE
    from .six_link import EXAMPLE, six_link_gantry_tau

    return six_link_gantry_tau, "d1_six_link", EXAMPLE


def gantry_tau(
    name: str,
    inertia: str | None = None,
    smoothing: str = "tanh",
    velocity_scale: float = VELOCITY_SCALE,
    payload: float = 0.0,
    rod: Any = None,
    **modifiers: Any,
) -> GantryTau:
    """Return a three-link Gantry-Tau with a printed geometry and an identified inertia model.

    No masses of D1 are printed: without `inertia`, d1_nominal takes an EXAMPLE OF OURS, the masses of the six-link D1
    with the link masses of each arm added up.

    Args:
        name: geometry, e.g. "l1_tape" (Dressler 2012, Table 5.7).
        inertia: masses [kg] and symmetric friction (Table 6.3): "model_1" or "model_2", the default of the L1 sets;
            links are massless.
        smoothing: "tanh" or "piecewise_linear" friction; "sign" for identification only; "stiction", friction that
            sticks, for simulation only.
        velocity_scale: velocity over which friction is smoothed [m/s].
        payload: mass added to the plate [kg], also to an m_p among the modifiers.
        rod: a Rod class instead of MidpointRod.
        modifiers: any parameter of GantryTau, e.g. m_a=[...].

    Raises ModelError for an unknown name, with close matches, and for a payload below 0.

    Forward kinematics of the L1, carts to tool centre point [m]; each row has its own status:

    >>> robot = gt.robots.gantry_tau("l1_tape", payload=5.0)
    >>> fk = robot.causal(known="q", targets="T")
    >>> T, status = fk([[-0.7, -0.8, -0.6], [-0.7, -0.8, 5.0]])
    >>> print(T[0].round(3), [gt.Status(s).name for s in status])
    [ 0.911 -0.883  0.463] ['OK', 'OUT_OF_RANGE']
    """
    geometry = _pick(name, _sets(), "three-link robot" if name in geometries() else "robot")
    friction = _pick(smoothing, SMOOTHINGS, "friction smoothing")
    A, v, L = (np.array(geometry[k], dtype=float) for k in ("A_m", "v", "L_m"))
    parts: dict[str, Any] = {"friction": friction} | ({} if rod is None else {"rod": rod})
    masses = _masses(geometry, inertia)
    m_p = _loaded(modifiers.pop("m_p", masses["m_p"]), payload)
    arm = _with_parts(parts, modifiers.pop("arm", {}))
    values: dict[str, Any] = dict(
        A=A,
        v=v,
        L=L,
        velocity_scale=velocity_scale,
        home=A.mean(axis=0) + 0.7 * L.mean() * v.mean(axis=0),
        arm=arm,
        **{**masses, "m_p": m_p},
    )
    return GantryTau(**{**values, **modifiers})


def _loaded(m_p: Any, payload: float) -> Any:
    """Return the plate mass [kg] with the payload. Raises ModelError for a payload below 0."""
    if payload < 0:
        raise ModelError(f"a payload is a mass of 0 kg or more; found {payload:g} kg")
    try:
        return m_p + payload if payload else m_p
    except TypeError:
        return m_p  # not a number: the parameter's declaration refuses it


def _with_parts(parts: dict[str, Any], modifiers: Any) -> Any:
    """Return the parts of every arm or cart, updated by the user's modifiers: one dict for all, or a list."""
    return [parts | m for m in modifiers] if isinstance(modifiers, (list, tuple)) else parts | modifiers


def _masses(geometry: dict[str, Any], inertia: str | None) -> dict[str, Any]:
    if inertia is None and geometry["prototype"] != "L1":
        from .six_link import EXAMPLE

        example: dict[str, Any] = EXAMPLE
        m_a = [float(example["m_a"][rows].sum()) for rows in links.ROWS]
        return {k: example[k] for k in ("m_p", "m_c", "coulomb", "viscous")} | {"m_a": m_a}
    model = _pick(inertia or "model_2", _inertias(), "inertia model")
    keys = {"m_p": "m_p_kg", "m_c": "m_c_kg", "coulomb": "coulomb_N", "viscous": "viscous_kg_s"}
    return {name: model[key] for name, key in keys.items()}


def _pick(name: str, table: dict[str, Any], what: str) -> Any:
    if name not in table:
        hint = meant(name, table, f"there are {', '.join(sorted(table))}", most=2)
        raise ModelError(f"there is no {what} '{name}'; {hint}")
    return table[name]
