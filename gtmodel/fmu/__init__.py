"""Functional mock-up units (FMI 3.0 and 2.0): the models inside other simulators and test benches.

export        a causal function, a step function or a model as an archive -> Fmu
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .export import Fmu as Fmu, export as export

public(__name__)
