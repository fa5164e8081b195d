"""C code from causal functions: a folder that compiles as delivered, and the proof that it is equal to Python.

study         all of it in one call: generated, compared with Python, costs counted, written -> CodeStudy
Verification  how it is compared

Its steps. Produce: generate -> Generated. Verify: check -> CheckReport. Measure: costs -> Costs, write_costs.
All raise GenerationError, one plain sentence, for what cannot be generated, written or compared.
"""

from .code_study import CodeStudy, study
from .costs_file import write_costs
from .errors import GenerationError
from .generation import Generated, generate
from .measurement import Costs, costs
from .options import Verification
from .verification.against_python import check
from .verification.report import CheckReport

__all__ = [
    "CheckReport", "CodeStudy", "Costs", "Generated", "GenerationError", "Verification", "check", "costs", "generate",
    "study", "write_costs",
]  # fmt: skip
