"""C code from causal functions: a folder that compiles as delivered, and the proof that it is equal to Python.

study         all of it in one call: generated, compared with Python, costs counted, written -> CodeStudy
Verification  how it is compared

StepFunction  what is computed once in a cycle from inputs and from what it remembers
BlockFunction a sampled block of a model as such a function

Its steps. Produce: generate -> Generated. Verify: check -> CheckReport. Measure: costs -> Costs, write_costs.
All raise GenerationError, one plain sentence, for what cannot be generated, written or compared.
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .code_result import CodeStudy as CodeStudy, Verification as Verification
    from .code_study import study as study
    from .costs_file import write_costs as write_costs
    from .generation import Generated as Generated, generate as generate
    from .measurement import Costs as Costs, costs as costs
    from .real import GenerationError as GenerationError
    from .steps.block import BlockFunction as BlockFunction
    from .steps.function import StepFunction as StepFunction
    from .verification.against_python import check as check
    from .verification.comparison import CheckReport as CheckReport

public(__name__)
