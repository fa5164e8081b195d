"""Checks for implausible robot parameters: metres for millimetres, degrees for radians, lost signs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..lang import Model, ModelError
from .six_link import ARM, LINKS

# link lengths [m] of a robot on carts: lengths outside this range are in another unit. The limits are a factor of 1000
# apart, so that no length is plausible in both metres and millimetres
SHORTEST, LONGEST = 0.02, 20.0
# distance of the farthest point from the origin, in link lengths: least and greatest. Cart joints may be anywhere in
# the room; joints in plate or joint-plate coordinates are within a fraction of a link. A wrong unit is a factor of 1000
SIZES = {
    "A": (0.0, 300.0),
    "A0": (0.01, 300.0),
    "A_bj": (1e-3, 10.0),
    "B": (1e-3, 10.0),
    "B0": (1e-3, 10.0),
    "r3": (1e-3, 10.0),
}
# motion of a cart joint per q: about 1; a wrong unit is a factor of 1000
MOTION = (0.1, 10.0)
ONE_CART = 0.1  # largest relative difference of that motion between links of one cart

# keys: the unit in the key's name, and whether the numbers are too small for it
_HINTS = {
    ("m", True): "are too short for a robot; give metres",
    ("m", False): "look like millimetres; give metres",
    ("mm", True): "look like metres; give millimetres",
    ("mm", False): "look like micrometres; give millimetres",
}


CENTRE = 2.0  # farthest centre of mass of a plate, in link lengths
# angles [rad]: the widest joint limit; and the distance to pi/2 or pi within which a number in degrees is suspect
MOST_TURNED, RIGHT = 8 * np.pi, 1e-3


def implausible_angle(values: Any, unit: str) -> str | None:
    """Return a sentence if angles in `unit` ("rad" or "deg") look like the other unit, else None."""
    a = np.abs(np.asarray(values, float))
    if a.size and a.max() > (MOST_TURNED if unit == "rad" else np.degrees(MOST_TURNED)):
        return f"angles up to {a.max():.6g} {unit} are more than four turns; " + (
            "they look like degrees: give radians" if unit == "rad" else "give smaller angles"
        )
    quarters = np.abs(a[..., None] - np.pi * np.array([0.5, 1.0])) < RIGHT
    if unit == "deg" and a.size and a.max() <= np.pi + RIGHT and np.any(quarters):
        return f"angles up to {a.max():.6g} deg look like radians; give degrees"
    return None


def implausible_arm(table: Mapping[str, Any]) -> tuple[str, str] | None:
    """Like `implausible_length`, for a serial arm given by Denavit-Hartenberg parameters."""
    for key in ("a_m", "d_m", "tool_m", "base_m"):
        far = np.max(np.abs(table.get(key) or [0.0]))
        if far > LONGEST:
            return key, f"lengths up to {far:g} m look like millimetres; give metres"
    for key in ("alpha_deg", "theta_deg", "beta_deg", "limits_deg", "start_deg", "base_rpy_deg", "tool_rpy_deg"):
        if wrong := implausible_angle(table.get(key) or [], "deg"):
            return key, wrong
    limits = table.get("limits") or []
    joints = list(table["joints"]) or ["r"]
    joints = joints if len(joints) == len(limits) else joints[:1] * len(limits)
    turning = [x for x, joint in zip(limits, joints, strict=True) if joint.startswith("r")]
    wrong = implausible_angle(turning, "rad")
    return ("limits", f"{wrong}, or write limits_deg") if wrong else _wrong_joints(table)


def _wrong_joints(table: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the key that `serial_arm` would refuse, with its sentence."""
    from .serial.dh import checked_joints  # here: implausible lengths of other robots need no arms

    keys = {"a": "a_m", "alpha": "alpha_deg", "d": "d_m", "theta": "theta_deg", "beta": "beta_deg", "m": "m_kg"}
    more = {}
    for name in ("limits", "start"):
        keys[name] = name if table.get(name) is not None else f"{name}_deg"
        more[name] = table[name] if table.get(name) is not None else _radians(table.get(f"{name}_deg"))
    numbers = {name: table[keys[name]] for name in ("a", "alpha", "d", "theta", "beta") if table.get(keys[name])}
    try:
        checked_joints(numbers, joints=table["joints"], names=table.get("names"), m=table.get("m_kg"), **more)
    except ModelError as error:
        return keys.get(error.argument, error.argument), str(error)
    return None


def _radians(degrees: Any) -> Any:
    try:
        return None if degrees is None else np.radians(degrees)
    except ValueError:  # rows of different lengths
        return degrees


def implausible_length(table: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the first key whose numbers are implausible in the unit of its name, with a sentence; or None.

    Points that are all zero are accepted.
    """
    with np.errstate(over="ignore"):  # a coordinate whose square overflows counts as infinitely far
        return _implausible_length(table)


def implausible_model(model: Model) -> tuple[str, str] | None:
    """Like `implausible_length`, for the parameters (SI units) of a robot on carts."""
    f1 = hasattr(model, "A0")
    names = {"A": "A_bj", "B": "B0"} if f1 else {}
    table = {f"{names.get(n, n)}_m": getattr(model, n) for n in ("A0", "A", "B", "L", "r3", "home", "c_p")
             if getattr(model, n, None) is not None}  # fmt: skip
    if wrong := implausible_length(table | {"v": model.v}):
        back = {new: old for old, new in names.items()}
        stem = wrong[0].removesuffix("_m")
        return back.get(stem, stem), wrong[1]
    return None


def _implausible_length(table: Mapping[str, Any]) -> tuple[str, str] | None:
    key = next(key for key in ("L_m", "L_mm") if key in table)
    unit, factor = ("m", 1.0) if key == "L_m" else ("mm", 1e-3)
    L = factor * np.array(table[key])
    if L.min() < SHORTEST or L.max() > LONGEST:
        what = f"link lengths from {L.min() / factor:.6g} to {L.max() / factor:.6g} {unit}"
        return key, f"{what} {_HINTS[unit, bool(L.min() < SHORTEST)]}"
    for stem, (least, greatest) in SIZES.items():
        points = np.array(table.get(f"{stem}_{unit}", [[0.0]]))
        size = factor * float(np.max(np.linalg.norm(points, axis=-1))) / L.max()
        if 0.0 < size < least or size > greatest:
            what = f"coordinates up to {np.max(np.abs(points)):.6g} {unit}"
            return f"{stem}_{unit}", f"{what} {_HINTS[unit, size < least]}"
    c_p = table.get("c_p_m")
    centre = 0.0 if c_p is None else float(np.linalg.norm(c_p))
    if centre > CENTRE * L.max():
        return (
            "c_p_m",
            f"the plate's centre of mass is {centre:.6g} m from T, but links are {L.max():.6g} m long; give metres",
        )
    if motion := _implausible_motion(np.atleast_2d(np.array(table["v"]))):
        return "v", motion
    far = _unreachable_home(table, unit, factor, L.max())
    return None if far is None else (f"home_{unit}", far)


def _unreachable_home(table: Mapping[str, Any], unit: str, factor: float, longest: float) -> str | None:
    """Return a sentence if `home` is farther from a guideway than the arm on it reaches at any plate orientation."""
    home = table.get(f"home_{unit}")
    if home is None:
        return None
    A = np.array(table.get(f"A0_{unit}", table.get(f"A_{unit}")))
    v = np.broadcast_to(np.array(table["v"]), A.shape)
    along = v / np.linalg.norm(v, axis=1, keepdims=True)
    d = np.array(home) - A
    away = factor * np.linalg.norm(d - along * np.sum(along * d, axis=1, keepdims=True), axis=1)
    bodies = [np.array(table[key]) for key in (f"{stem}_{unit}" for stem in ("B", "B0", "A_bj", "r3")) if key in table]
    reach = longest + factor * sum(float(np.max(np.linalg.norm(x, axis=-1))) for x in bodies)
    k = int(np.argmax(away))
    if away[k] <= reach:
        return None
    return (f"is {away[k]:.6g} m away from guideway {k + 1}, whose arm reaches {reach:.6g} m; give a point "
            f"within reach, in {'metres' if unit == 'm' else 'millimetres'}")  # fmt: skip


def _implausible_motion(v: np.ndarray) -> str | None:
    """Return a sentence if v does not move a cart joint by about q, or differs between the links of one cart."""
    size = np.linalg.norm(v, axis=1)
    wrong = np.flatnonzero((size < MOTION[0]) | (size > MOTION[1]))
    if len(wrong):
        k = int(wrong[0])
        motion = f"row {k + 1} moves its cart joint by {size[k]:.6g} m per metre of q; expected about 1"
        return f"{motion}, the length of a guideway direction"
    if len(v) != len(ARM):
        return None
    for k, arm in enumerate(ARM):
        first = ARM.index(arm)
        apart = float(np.linalg.norm(v[k] - v[first]) / size[first])
        if apart > ONE_CART:
            return (f"links {LINKS[first]} and {LINKS[k]} are on one cart, but their rows differ by "
                    f"{100 * apart:.0f} %; a sign or a row is probably wrong")  # fmt: skip
    return None
