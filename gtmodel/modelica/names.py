"""References to Modelica classes, such as "vdp.mop:VDP_Opt", and the folders of libraries."""

from __future__ import annotations

import os

ENDINGS = (".mop", ".mo")
MODELICAPATH = "MODELICAPATH"


def is_reference(reference: str) -> bool:
    """True if a string names a Modelica file or a class in one: `vdp.mop`, `vdp.mop:VDP_Opt`."""
    return split(reference)[0].endswith(ENDINGS)


def split(reference: str) -> tuple[str, str]:
    """Split `file.mop:Class` into file and class; the class is "" if none is named."""
    place, colon, name = reference.rpartition(":")
    return (place, name) if colon and place.endswith(ENDINGS) else (reference, "")


def libraries() -> list[str]:
    """Return the folders of the environment variable MODELICAPATH, as in other Modelica tools."""
    return [p for p in os.environ.get(MODELICAPATH, "").split(os.pathsep) if p]
