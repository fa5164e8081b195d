"""References to Modelica classes, "vdp.mop:VDP_Opt", for callers that must start before the parser is imported."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .names import is_reference as is_reference, libraries as libraries, split as split

if TYPE_CHECKING:
    from .translate import Translation
else:
    from .._lazy import hint

    Translation = hint("gtmodel.modelica.translate", "Translation")


def translated(
    reference: str, *, library: Iterable[str], parameters: Mapping[str, Any], flattener: str = "gtmodel"
) -> Translation:
    """See `gtmodel.modelica.translate`."""
    from .translate import translated as of

    return of(reference, library=library, parameters=parameters, flattener=flattener)


def problem_of(reference: str) -> tuple[Path, dict[str, Any]]:
    """Return the file and the keys of a problem file for one class.

    The kind is "optimization", or "simulation" for a model, which ends at the StopTime of its experiment annotation
    or, without one, at 1 s. Raises ModelicaError.
    """
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


def whole(reference: str) -> str:
    """Return a reference completed by its class if none is named; the file must contain one optimization or one model.

    Raises ModelicaError.
    """
    from .translate import chosen, opened

    place, name = split(reference)
    return reference if name else f"{place}:{chosen(opened(place, libraries()), name)[0]}"
