"""The catalogue: robots built from the parameter sets printed in Dressler 2012."""

from __future__ import annotations

import difflib
import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from ..lang import ModelError
from ..mechanics import PiecewiseLinearFriction, TanhFriction
from .three_link import GantryTau

SMOOTHINGS = {"tanh": TanhFriction, "piecewise_linear": PiecewiseLinearFriction}


@cache
def _table(name: str) -> dict[str, Any]:
    return tomllib.loads(files("gtmodel.robots").joinpath("data", name).read_text(encoding="utf-8"))


def _sets() -> dict[str, dict[str, Any]]:
    """Three-arm sets by name. No masses of D1 are printed: the L1 inertia stands in as an example of ours."""
    table = _table("gantry_tau.toml")
    return {k: v for k, v in table.items() if v.get("prototype") in ("L1", "D1") and len(v["L_m"]) == 3}


def _inertias() -> dict[str, dict[str, Any]]:
    """Identified inertia models whose friction is symmetric and printed in full."""
    table = _table("gantry_tau_dynamics.toml")["inertia"]
    return {k: v for k, v in table.items() if "*" not in (v["coulomb_N"], v["viscous_kg_s"])}


def names() -> dict[str, str]:
    """Catalogue names with their sources."""
    stand_in = "; masses and friction of the L1, an example of ours"
    return {k: v["source"] + (stand_in if v["prototype"] == "D1" else "") for k, v in sorted(_sets().items())}


def inertia_names() -> list[str]:
    """Names of the identified inertia and friction models (Dressler 2012, Table 6.3)."""
    return sorted(_inertias())


def gantry_tau(
    name: str,
    inertia: str = "model_2",
    smoothing: str = "tanh",
    velocity_scale: float = 0.1,
    payload: float = 0.0,
    rod: Any = None,
    **modifiers: Any,
) -> GantryTau:
    """A three-link Gantry-Tau from a printed geometry and an identified inertia model.

    Args:
        name: geometry, e.g. "l1_tape" (Dressler 2012, Table 5.7).
        inertia: masses [kg] and symmetric friction (Table 6.3): "model_1" or "model_2"; links are massless.
        smoothing: "tanh" or "piecewise_linear" friction.
        velocity_scale: velocity of the smoothing [m/s].
        payload: mass added to the plate [kg].
        rod: a Rod class in place of MidpointRod.
        modifiers: any parameter of GantryTau, e.g. m_a=[...].

    Raises ModelError for an unknown name, with close matches.
    """
    geometry = _pick(name, _sets(), "robot")
    masses = _pick(inertia, _inertias(), "inertia model")
    friction = _pick(smoothing, SMOOTHINGS, "friction smoothing")
    A, v, L = (np.array(geometry[k], dtype=float) for k in ("A_m", "v", "L_m"))
    parts: dict[str, Any] = {"friction": friction} | ({} if rod is None else {"rod": rod})
    arm = modifiers.pop("arm", {})  # such as dict(guideway=...), for all arms or one each
    values: dict[str, Any] = dict(
        A=A,
        v=v,
        L=L,
        m_p=masses["m_p_kg"] + payload,
        m_c=masses["m_c_kg"],
        coulomb=masses["coulomb_N"],
        viscous=masses["viscous_kg_s"],
        velocity_scale=velocity_scale,
        home=A.mean(axis=0) + 0.7 * L.mean() * v.mean(axis=0),
        arm=[parts | one for one in arm] if isinstance(arm, (list, tuple)) else parts | arm,
    )
    return GantryTau(**{**values, **modifiers})


def _pick(name: str, table: dict[str, Any], what: str) -> Any:
    if name not in table:
        close = difflib.get_close_matches(name, table, n=2)
        hint = f"did you mean {' or '.join(close)}?" if close else f"there are {', '.join(sorted(table))}"
        raise ModelError(f"there is no {what} '{name}'; {hint}")
    return table[name]
