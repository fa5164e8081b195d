"""gtmodel: write a robot's equations once; every causality is derived.

Language: Model, Connector, Optimization; variable, input, parameter, part, parts, port, outer, connect, der.
Engines: Model.causal (any causality), kinematics (all assembly modes), solve (optimal control), calibrate (closure
equations and measured poses), inference (what data say), cgen.generate (C code).
"""

import importlib
from typing import TYPE_CHECKING, Any

from . import calibrate, inference, kinematics, mechanics
from . import lang as _lang
from .compiler.causal import CausalFunction, compile_causal
from .lang import *  # noqa: F403
from .optimize import (
    Blocks,
    Mesh,
    NotSolved,
    Phases,
    Refinement,
    Resimulation,
    Solution,
    SolverOptions,
    estimate,
    multi_start,
    refine,
    resimulate,
    solve,
    solve_phases,
    transcribe,
)
from .results import Estimate, SolveStatus, Status, Trajectory
from .simulate import NotSimulated, Simulation, linearize, modes, simulate

if TYPE_CHECKING:
    from . import robots

# what a person calls on a model lives in the engines; bound here so that the language imports none of them
for _cls in (_lang.Model, _lang.Builder):
    _cls.causal = compile_causal
    _cls.simulate = simulate

__version__ = "0.1.0"

__all__ = [
    "Blocks",
    "CausalFunction",
    "Estimate",
    "Mesh",
    "NotSimulated",
    "NotSolved",
    "Phases",
    "Refinement",
    "Resimulation",
    "Simulation",
    "Solution",
    "SolveStatus",
    "SolverOptions",
    "Status",
    "Trajectory",
    "calibrate",
    "estimate",
    "inference",
    "kinematics",
    "linearize",
    "mechanics",
    "modes",
    "multi_start",
    "refine",
    "resimulate",
    "robots",
    "simulate",
    "solve",
    "solve_phases",
    "transcribe",
]
__all__ += _lang.__all__


def __getattr__(name: str) -> Any:
    # the core stands without the robots (a test deletes them): they are imported when first asked for
    if name == "robots":
        return importlib.import_module(".robots", __name__)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
