"""C code from causal functions: a folder that compiles as it is, and its comparison with Python.

study         generate, compare with Python and write, on request count costs, in one call -> CodeStudy
Verification  options of the comparison

jacobian_function  the derivatives of a causal function, as a function of its own
StepFunction  a function with a state that runs once in a cycle
BlockFunction a sampled block of a model as a step function

The single steps: generate -> Generated; check -> CheckReport; costs -> Costs; write_costs. All raise GenerationError
if code cannot be generated, written or compared.
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .code_result import CodeStudy as CodeStudy, Verification as Verification
    from .code_study import study as study
    from .costs_file import write_costs as write_costs
    from .generation import Generated as Generated, generate as generate
    from .jacobian_function import jacobian_function as jacobian_function
    from .measurement import Costs as Costs, costs as costs
    from .real import GenerationError as GenerationError
    from .steps.block import BlockFunction as BlockFunction
    from .steps.function import StepFunction as StepFunction
    from .verification.against_python import check as check
    from .verification.comparison import CheckReport as CheckReport

public(__name__)
