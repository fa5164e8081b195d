"""Tables that stop moving, or begin to, at a jump: an impulse where a model needs a higher derivative."""

from __future__ import annotations

from collections.abc import Sequence

from ..lang.source import ModelError
from .inputs import Inputs

# of a derivative's largest size in its table: splines of measured rows end at rest only so well
AT_REST = 1e-3


def refuse_impulsive_inputs(inputs: Inputs, needed: Sequence[tuple[int, int]], start: float, end: float) -> None:
    """Raises ModelError for a table whose end inside the run makes a derivative jump that another one is needed of.

    needed: (index, order) of the derivatives that the model reads.
    """
    for index, order in needed:
        table = inputs.tables.get(index)
        if table is None:
            continue
        for time, before in ((float(table.times[0]), False), (float(table.times[-1]), True)):
            held = start < time if not before else time < end
            if not held or not start <= time <= end or len(table.times) < 2:
                continue
            moving = table.piece(time, before)
            for k in range(1, min(order, table.coefficients)):
                if abs(moving[k]) > AT_REST * table.largest(k):
                    name, rate = inputs.flat.symbol_name(index, order), inputs.flat.symbol_name(index, k)
                    what = "begins" if not before else "ends"
                    raise ModelError(
                        f"the table of input '{table.name}' {what} at {time:g} s with {rate} = {moving[k]:.3g} and is "
                        f"held beyond, so that {name}, which the model needs, has an impulse there; extend the table "
                        f"over the run, or let it {what[:-1]} at rest"
                    )
