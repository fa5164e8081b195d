"""References to classes of texts, "vdp.mop:VDP_Opt", for doors that start before any text is read."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .translate import Translation
else:
    from .._lazy import hint

    Translation = hint("gtmodel.modelica.translate", "Translation")

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


def translated(reference: str, *, library: Iterable[str], parameters: Mapping[str, Any]) -> Translation:
    """See `gtmodel.modelica.translate`."""
    from .translate import translated as of

    return of(reference, library=library, parameters=parameters)


def problem_of(reference: str) -> tuple[Path, dict[str, Any]]:
    """The file, and the keys of a problem file of this one class: kind "optimization", or "simulation" of a model until
    the StopTime of its experiment annotation, else 1 s. Raises ModelicaError."""
    from .translate import chosen, opened, stop_time_of

    place, name = split(reference)
    text = opened(place, libraries())
    name, space = chosen(text, name)
    title = f"{name} of {Path(place).name}"
    model = f"{Path(place).name}:{name}"
    if space.text.restriction == "optimization":
        return Path(place), {"kind": "optimization", "title": title, "model": model}
    stop = stop_time_of(space.text) or 1.0
    return Path(place), {"kind": "simulation", "title": title, "robot": model, "final_time_s": stop}
