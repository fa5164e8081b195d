"""Sweeps: a study run for many values of its arguments, on all cores or a cluster, into one table.

study             run every row; with a folder, rows that are done stay done
Sweep             the result: status, table, failed rows, picture, `frame()` for pandas
Uniform, LogUniform, Normal, OneOf    distributions of a random design
design, Design    the rows of a sweep, by number
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .design import (
        Design as Design,
        LogUniform as LogUniform,
        Normal as Normal,
        OneOf as OneOf,
        Uniform as Uniform,
        design as design,
    )
    from .sweep_study import Sweep as Sweep, study as study

public(__name__)
