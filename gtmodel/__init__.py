"""gtmodel: write a robot's equations once; every causality is derived.

Language: Model, Connector, Optimization; variable, input, parameter, part, parts, port, outer, connect, der.
Engines: Model.causal (any causality), solve (optimal control), simulate, cgen.generate (C code).
Libraries, imported when first used: calibrate, cgen, compliance, control, identify, inference, kinematics, loop,
measurements, mechanics, milling, motion, optimize, plot, results, robots, simulation, vibration.
load("problem.toml") gives the study that a problem file means, as a call on objects.
"""

import importlib
import os as _os
import signal as _signal
import sys as _sys
from contextlib import suppress as _suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

# as a command, Ctrl-C during the imports ends the process and shows no traceback; cli.main takes over from here
if _sys.argv and _os.path.basename(_sys.argv[0]) in ("-m", "gtmodel", "gtmodel.exe"):
    with _suppress(ValueError):  # not the main thread
        _signal.signal(_signal.SIGINT, _signal.SIG_DFL)

from . import lang as _lang
from ._version import __version__ as __version__
from .compiler.causal import CausalFunction, compile_causal
from .lang import *  # noqa: F403
from .lang.slips import near as _near
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
from .simulation import NotSimulated, Simulation, linearize, natural_modes, simulate

if TYPE_CHECKING:
    from . import (
        calibrate,
        cgen,
        compliance,
        control,
        identify,
        inference,
        kinematics,
        loop,
        measurements,
        mechanics,
        milling,
        motion,
        optimize,
        plot,
        results,
        robots,
        simulation,
        vibration,
    )

# imported when first asked for: the core stands without them (a test deletes the robots), and starts sooner
_LIBRARIES = [
    "calibrate", "cgen", "compliance", "control", "identify", "inference", "kinematics", "loop", "measurements",
    "mechanics", "milling", "motion", "optimize", "plot", "results", "robots", "simulation", "vibration",
]  # fmt: skip
# what a person calls on a model lives in the engines; bound here so that the language imports none of them
for _cls in (_lang.Model, _lang.Builder):
    _cls.causal = compile_causal
    _cls.simulate = simulate

__all__ = [
    "Blocks", "CausalFunction", "Estimate", "Mesh", "NotSimulated", "NotSolved", "Phases", "Refinement", "Resimulation",
    "Simulation", "Solution", "SolveStatus", "SolverOptions", "Status", "Trajectory", "calibrate", "cgen", "compliance",
    "control", "estimate", "identify", "inference", "kinematics", "linearize", "load", "loop", "measurements",
    "mechanics", "milling", "motion", "multi_start", "natural_modes", "optimize", "plot", "refine", "resimulate",
    "results", "robots", "simulate", "simulation", "solve", "solve_phases", "transcribe", "vibration",
]  # fmt: skip
__all__ += _lang.__all__


def load(path: str | Path, *settings: str) -> Any:
    """The study that a problem file means, as a `Call` on Python objects: look at it, change it, call it.

    path: a TOML file, or the name of a problem shipped with gtmodel. settings: "key=value", as `--set` takes them.
    Raises InputError, with file and key.

    >>> import gtmodel as gt
    >>> call = gt.load("compliance_l1", "section.step_m=0.3")
    >>> call.options["frequencies"] = 1
    >>> call().frequencies.shape
    (1,)
    """
    from .problem_files.run import call_of

    return call_of(path, settings)


def __getattr__(name: str) -> Any:
    if name in _LIBRARIES:
        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'{_near(name, __dir__())}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_LIBRARIES})
