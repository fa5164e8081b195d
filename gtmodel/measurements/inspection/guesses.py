"""In which unit a column probably is, and from what that is concluded. A guess is called a guess."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from ...results.interpolation import NEAR, nature_of
from ...results.quantity import unit_of
from ...results.trajectory_checks import Array
from ..streams.heads import is_unit, spelled
from .columns import ColumnFacts

G = 9.81  # m/s2
TURN_RAD, TURN_DEG = 3.2, 7.0  # an angle below the first is probably in rad, above the second in deg
_FORCES = r"force|torque|effort|tau|moment|drehm|load"
_ANGLES = r"angle|joint|axis|motor|enc|rot|phi|theta|psi|roll|pitch|yaw|winkel|achse|^q\d*$|^q\[|^j\d+$"
_RATES = r"gyr|omega|angular_vel|rate"
_PLACES = r"pos|tcp|place|coord|travel|stroke|height|length|leg|^[xyz]\d*$|(^|[._])[xyz]$|cart"
_ACCELERATIONS = r"acc"
_TIMES = r"(^|[._ /])(t|time|zeit|stamp|timestamp|clock|uhr)($|[._ \[])|time$|stamp$"
_NOTHING = r"count|index|token|_id$|number|flag|state|status|mode|seq"


class UnitGuess(NamedTuple):
    """A unit, "" where none can be guessed; why; and whether the file says so itself, so that it is no guess."""

    unit: str
    why: str
    stated: bool = False


def is_time(name: str) -> bool:
    """Whether a column is called like a time."""
    return re.search(_TIMES, name.lower()) is not None


def unit_guess(facts: ColumnFacts, stated: str, head: Array, group: Array | None) -> UnitGuess:
    """The unit of a column, from the header, its name, or its numbers.

    stated: in the header, "" if it is not there. head: its first rows. group: those of the vector that it belongs to,
    (n, k), None for none.
    """
    if stated:
        return UnitGuess(stated, "stands in the header", stated=True)
    name = re.sub(r"\[\d+\]$", "", facts.name)
    if unit := unit_of_name(name):
        return UnitGuess(unit, f"the name ends in it: {name}")
    if facts.constant or not facts.rows:
        return UnitGuess("", "")
    lower, size = name.lower(), max(abs(facts.least), abs(facts.most))
    if re.search(_NOTHING, lower) and np.all(head[np.isfinite(head)] % 1 == 0):
        return UnitGuess("1", "whole numbers: a count or a state")
    if is_time(name):
        return _of_time(facts, head)
    if group is not None and (known := _of_vector(lower, group)) is not None:
        return known
    if re.search(_RATES, lower):
        if size > 35.0:
            return UnitGuess("deg/s", f"called like an angular velocity, up to {size:.3g}: too fast for rad/s")
        return UnitGuess("rad/s", f"called like an angular velocity, within {size:.3g}")
    if re.search(_ACCELERATIONS, lower) or re.search(_FORCES, lower):
        return UnitGuess("", "")
    if re.search(_ANGLES, lower) and not re.search(r"vel|speed|_d\d", lower):
        if size <= TURN_RAD:
            return UnitGuess("rad", f"called like an angle, within ±{size:.3g}: less than half a turn in rad")
        if TURN_DEG < size <= 3600.0:
            return UnitGuess("deg", f"called like an angle, up to {size:.4g}")
    if re.search(_PLACES, lower) and not re.search(r"vel|speed", lower):
        if size > 20.0:
            return UnitGuess("mm", f"called like a position, up to {size:.4g}: too far for m")
        if 0.0 < size <= 10.0 and "leg" not in lower:
            return UnitGuess("m", f"called like a position, within {size:.3g}")
    return UnitGuess("", "")


def unit_of_name(name: str) -> str:
    """The unit in which a name ends: force_N, act_vel_deg_per_s, torque_nm."""
    plain = re.sub(r"_per_", "_", name)
    last = re.split(r"[_.\s/]", plain)[-1]
    if last.lower() == "nm":
        return "N.m"
    if "_" in plain and (unit := unit_of(plain.rpartition(".")[2])):
        # one capital letter is more often a name, as in q_A, but N and V
        return "" if len(unit) == 1 and unit not in "NVms" else unit
    text = spelled(last)
    return text if len(text) > 1 and text != name and is_unit(text) else ""


def _of_time(facts: ColumnFacts, head: Array) -> UnitGuess:
    """Epochs are known by their size; of what counts from zero the step may say it."""
    for unit, low in (("ns", 1e18), ("us", 1e15), ("ms", 1e12), ("s", 1e9)):
        if low < facts.least and facts.most < 4 * low:
            return UnitGuess(unit, f"about {facts.least:.4g}: {unit} since 1970")
    step = float(np.nanmedian(np.abs(np.diff(head)))) if len(head) > 1 else 0.0
    if facts.step == 1.0 and step == 1.0:
        return UnitGuess("1", "counts rows")
    for unit, low, high in (("s", 1e-5, 0.5), ("ms", 0.5, 500.0), ("us", 500.0, 5e5), ("ns", 5e5, 5e8)):
        if low <= step < high:
            return UnitGuess(unit, f"called like a time, {step:.4g} from row to row")
    return UnitGuess("", "")


def _of_vector(lower: str, group: Array) -> UnitGuess | None:
    """Of quaternions, and of accelerations at rest, the length is known."""
    whole = group[np.isfinite(group).all(axis=1)]
    if not len(whole):
        return None
    length = np.linalg.norm(whole, axis=1)
    middle = float(np.median(length))
    off = np.abs(length - 1.0) > NEAR
    if nature_of(whole, "1", near=NEAR) == "quaternion":
        but = f", but {off.sum()} rows are off, the worst of length {length[np.argmax(np.abs(length - 1))]:.2g}"
        return UnitGuess("1", f"four columns of length 1: a quaternion{but if off.any() else ''}")
    if group.shape[1] == 3 and re.search(_ACCELERATIONS, lower):
        for unit, one, said in (("m/s2", G, "9.81 m/s2"), ("", 1.0, "1, so the unit is probably g = 9.81 m/s2"),
                                ("", 1000.0, "1000, so the unit is probably a thousandth of g")):  # fmt: skip
            if abs(middle - one) < 3 * NEAR * one:
                return UnitGuess(unit, f"rests at {middle:.4g}, near {said}")
    return None
