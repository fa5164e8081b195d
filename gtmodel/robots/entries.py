"""Entries of the catalogue by name, read from the printed tables without building a robot."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple


@cache
def printed(name: str) -> dict[str, Any]:
    """Return a file of `data`, such as "gantry_tau.toml". It is cached: do not modify it."""
    return tomllib.loads(files("gtmodel.robots").joinpath("data", name).read_text(encoding="utf-8"))


KR500_SOURCE = "maker's data sheet; Cvitanic 2021, Tables 1 and 2, Fig. 42"
NO_MASSES = "none printed"
# sources of masses and friction
EXAMPLE_MASSES = "an example of ours"
IDENTIFIED_MASSES = "Dressler 2012, Table 6.3"


class CatalogueEntry(NamedTuple):
    """A robot of the catalogue: its family, degrees of freedom, source of its geometry and origin of its masses."""

    family: str
    degrees_of_freedom: int
    source: str
    masses: str


FAMILIES = {"three_link": 3, "six_link": 3, "f1": 6, "serial": 6}  # with their degrees of freedom


def geometries() -> dict[str, dict[str, Any]]:
    """The printed geometries of Gantry-Taus by name."""
    return {name: table for name, table in printed("gantry_tau.toml").items() if "prototype" in table}


def family_in(table: dict[str, Any]) -> str:
    """Return the family of a printed geometry."""
    if table["prototype"] == "F1":
        return "f1"
    return "six_link" if "B_m" in table else "three_link"


def entries() -> dict[str, CatalogueEntry]:
    """Return the robots of the catalogue by name: family, degrees of freedom, source of the geometry and the masses.

    >>> for name, entry in gt.robots.entries().items():
    ...     print(f"{name:16s} {entry.family:11s} {entry.degrees_of_freedom}")
    ...
    d1_nominal       three_link  3
    d1_six_link      six_link    3
    f1               f1          6
    kr500            serial      6
    l1_camera        three_link  3
    l1_tape          three_link  3
    l1_tracker       three_link  3
    l1_tracker_2008  three_link  3
    l1_vision        three_link  3
    """
    by_name = {}
    for name, table in sorted(geometries().items()):
        family = family_in(table)
        masses = IDENTIFIED_MASSES if table["prototype"] == "L1" else EXAMPLE_MASSES
        by_name[name] = CatalogueEntry(family, FAMILIES[family], table["source"], masses)
    by_name["kr500"] = CatalogueEntry("serial", FAMILIES["serial"], KR500_SOURCE, NO_MASSES)
    return dict(sorted(by_name.items()))


def names() -> dict[str, str]:
    """Return the names of the robots of the catalogue, each with the source of its geometry.

    >>> gt.robots.names()["l1_tape"]
    'Dressler 2012, Table 5.7 manually measured'
    """
    return {name: entry.source for name, entry in entries().items()}
