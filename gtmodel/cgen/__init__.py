"""C code from causal functions: a folder that compiles as delivered, and the proof that it is equal to Python.

Produce: generate -> Generated. Verify: check -> CheckReport of Checks. Measure: costs -> Costs, write_costs. All raise
GenerationError, one plain sentence, for what cannot be generated, written or compared.
"""

from .costs_file import write_costs
from .errors import GenerationError
from .generation import Generated, generate
from .measurement import Costs, costs
from .report import Check, CheckReport
from .verification import check

__all__ = ["Check", "CheckReport", "Costs", "Generated", "GenerationError", "check", "costs", "generate", "write_costs"]
