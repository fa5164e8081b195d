"""How a class of a text is named: "vdp.mop:VDP_Opt"; and where its libraries lie."""

from __future__ import annotations

import os

ENDINGS = (".mop", ".mo")
MODELICAPATH = "MODELICAPATH"


def is_reference(reference: str) -> bool:
    """Does a text name a Modelica file, or a class in one: `vdp.mop`, `vdp.mop:VDP_Opt`?"""
    return split(reference)[0].endswith(ENDINGS)


def split(reference: str) -> tuple[str, str]:
    """File and class of `file.mop:Class`; "" where it names no class."""
    place, colon, name = reference.rpartition(":")
    return (place, name) if colon and place.endswith(ENDINGS) else (reference, "")


def libraries() -> list[str]:
    """Folders of the environment variable MODELICAPATH, as other Modelica tools read it."""
    return [p for p in os.environ.get(MODELICAPATH, "").split(os.pathsep) if p]
