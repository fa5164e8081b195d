"""Which functions have a kernel on columns, and from how many rows on it is used."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import casadi as ca

from .kernel import ColumnKernel
from .program import program_of

# rows of a call from which a kernel is the faster one, and rows in all after which making it has paid: reading an
# instruction costs as much as CasADi's virtual machine takes for it on some thousand rows
FEWEST, PAID = 128, 1024
KEPT = 64  # functions


@dataclass
class _Entry:
    """A function, which is held so that its number stays its own, with the rows seen so far."""

    function: ca.Function
    rows: int = 0
    kernel: ColumnKernel | None = None
    impossible: bool = False


_entries: OrderedDict[int, _Entry] = OrderedDict()


def kernel_of(f: ca.Function, rows: int) -> ColumnKernel | None:
    """The kernel for a call on so many rows; None where CasADi's virtual machine is to take them."""
    if rows < FEWEST:
        return None
    key = f.__hash__()
    entry = _entries.setdefault(key, _Entry(f))
    try:
        _entries.move_to_end(key)
        while len(_entries) > KEPT:
            _entries.popitem(last=False)
    except KeyError:
        pass  # another thread has just taken it away
    entry.rows += rows
    if entry.kernel is None and not entry.impossible and entry.rows >= PAID:
        program = program_of(f)
        entry.impossible = program is None
        entry.kernel = None if program is None else ColumnKernel(program)
    return entry.kernel
