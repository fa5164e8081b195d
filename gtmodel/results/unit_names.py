"""The unit that a name carries: ``force_N`` is in N, ``velocity_scale_m_s`` in m/s."""

from __future__ import annotations

from functools import cache

from ..lang.units import UnitError, parse_unit

_SPELLED = {"percent": "%", "Nm": "N.m", "kgm": "kg.m", "kgm2": "kg.m2"}
_TORQUES = {"Nm": "N.m", "MNm": "MN.m"}  # before what divides: Nm_rad is N.m/rad, not rad
_PER = "per"
_NO_UNIT = {"min"}  # the smallest, never minutes


@cache
def split(name: str) -> tuple[str, str]:
    """Stem and unit of a key, ("force", "N"); the unit is "" when the name carries none.

    The longest ending that reads as a unit counts; what follows its first symbol divides: ``m_s2`` is m/s2, as
    ``m_per_s2`` is; ``per_s`` is 1/s.
    """
    words = name.split("_")
    for i in range(1, len(words)):
        unit = _unit(words[i:])
        if unit:
            return "_".join(words[:i]), unit
    return name, ""


def _unit(words: list[str]) -> str:
    if not all(words) or _NO_UNIT.intersection(words) or words[-1] == _PER:
        return ""
    if words[0] == _PER:
        words = ["1", *words]
    words = [word for word in words if word != _PER]
    if len(words) == 1 and words[0] in _SPELLED:
        return _SPELLED[words[0]]
    text = "/".join(_TORQUES.get(word, word) for word in words)
    try:
        parse_unit(text)
    except UnitError:
        return ""
    return text


def unit_of(name: str) -> str:
    """Unit text of a key; "" when its name carries none."""
    return split(name)[1]


@cache
def named(stem: str, unit: str) -> str:
    """The name that carries a unit: ("force", "N") is ``force_N``. Raises ValueError for a unit no name can carry."""
    if not unit or unit == "1":
        return stem
    text = {spelled: word for word, spelled in _SPELLED.items()}.get(unit, unit)
    name = f"{stem}_{text.replace('.', '').replace('/', '_')}"
    if split(name) != (stem, unit):
        raise ValueError(f"no name carries the unit {unit}: '{name}' reads as {split(name)[1] or 'none'}")
    return name
