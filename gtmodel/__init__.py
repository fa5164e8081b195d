"""gtmodel: write a robot's equations once; gtmodel derives every causality.

Language: Model, Connector, Optimization; variable, input, parameter, part, parts, port, outer, connect, der.
Engines: Model.causal (any causality), solve (optimal control), simulate, cgen.generate (C code).
Libraries, imported when first used: calibrate, certify, cgen, compliance, control, filtering, fmu, identify, inference,
kinematics, loop, measurements, mechanics, milling, modelica, motion, optimize, plot, predictive, results, robots,
simulation, sweep, vibration, vision, workers.
load("problem.toml") returns the study that a problem file describes, as a call on Python objects,
load_robot the model of a robot file, shipped the path of a file that comes with gtmodel.
"""

import os as _os
import signal as _signal
import sys as _sys
from contextlib import suppress as _suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

# as a command, Ctrl-C during the imports ends the process without a traceback; later, cli.main handles it
if _sys.argv and _os.path.basename(_sys.argv[0]) in ("-m", "gtmodel", "gtmodel.exe"):
    with _suppress(ValueError):  # not the main thread
        _signal.signal(_signal.SIGINT, _signal.SIG_DFL)

from ._lazy import public as _public
from ._version import __version__ as __version__

if TYPE_CHECKING:
    from . import (
        calibrate as calibrate,
        certify as certify,
        cgen as cgen,
        compliance as compliance,
        control as control,
        filtering as filtering,
        fmu as fmu,
        identify as identify,
        inference as inference,
        kinematics as kinematics,
        loop as loop,
        measurements as measurements,
        mechanics as mechanics,
        milling as milling,
        modelica as modelica,
        motion as motion,
        optimize as optimize,
        plot as plot,
        predictive as predictive,
        results as results,
        robots as robots,
        simulation as simulation,
        sweep as sweep,
        vibration as vibration,
        view as view,
        vision as vision,
        workers as workers,
    )
    from .compiler.causal import CausalFunction as CausalFunction
    from .lang import *  # noqa: F403
    from .optimize import (
        Blocks as Blocks,
        LengthCost as LengthCost,
        Mesh as Mesh,
        NotSolved as NotSolved,
        Phases as Phases,
        Refinement as Refinement,
        Resimulation as Resimulation,
        Solution as Solution,
        SolverOptions as SolverOptions,
        estimate as estimate,
        multi_start as multi_start,
        phases_of_events as phases_of_events,
        refine as refine,
        resimulate as resimulate,
        solve as solve,
        solve_phases as solve_phases,
        transcribe as transcribe,
    )
    from .results import Estimate as Estimate, SolveStatus as SolveStatus, Status as Status, Trajectory as Trajectory
    from .simulation import (
        NotSimulated as NotSimulated,
        Simulation as Simulation,
        linearize as linearize,
        natural_modes as natural_modes,
        simulate as simulate,
    )

__all__ = ["load", "load_robot", "shipped"]


def load(path: str | Path, *settings: str) -> Any:
    """Return the study that a problem file describes, as a `Call`: its arguments can be changed before the run.

    path: a TOML file, or the name of a problem shipped with gtmodel. settings: "key=value", as for `--set`.
    Raises InputError, which names file and key.

    >>> import gtmodel as gt
    >>> call = gt.load("compliance_l1", "section.step_m=0.3")
    >>> call.options["frequencies"] = 1
    >>> call().frequencies.shape
    (1,)
    """
    from .problem_files.run import call_of

    return call_of(path, settings)


def load_robot(
    robot: str | Path, *, inertia: str | None = None, smoothing: str | None = None, velocity_scale: float | None = None,
    payload: float | None = None, **parameters: Any,
) -> Any:  # fmt: skip
    """The model of a robot that is named as in a problem file, such as a robot file of one's own.

    Args:
        robot: a robot file, such as the parameters.toml of a calibration, "arm.urdf" or "arm.urdf:tip" (also .sdf and
            .xml), "file.py:Class", or a name of the catalogue. Paths start at the working directory.
        inertia, smoothing, velocity_scale [m/s], payload [kg]: as in `gt.robots.gantry_tau`.
        parameters: new values of the model's parameters, by name.

    Raises InputError, with file, key and line. Parts of a URDF that are not used are a UserWarning.

    >>> import gtmodel as gt
    >>> type(gt.load_robot(gt.shipped("models/six_axis_arm.toml"))).__name__
    'SerialArm'
    """
    from warnings import warn

    from .problem_files.base import Context
    from .problem_files.robots import resolve

    context = Context(name="robot", notice=lambda sentence: warn(sentence, stacklevel=4))
    return resolve(
        str(robot), context, key="", parameters=parameters, inertia=inertia, smoothing=smoothing,
        velocity_scale=velocity_scale, payload=payload,
    )  # fmt: skip


def shipped(name: str) -> Path:
    """The path of a file that comes with gtmodel, below its folder `problems`: a problem, a model or data.

    Raises FileNotFoundError if there is no such file.

    >>> import gtmodel as gt
    >>> gt.shipped("l1_min_time.toml").name
    'l1_min_time.toml'
    """
    from ._files import problems_dir

    path = problems_dir() / name
    if not path.is_file():
        from ._near import near

        names = [p.relative_to(problems_dir()).as_posix() for p in problems_dir().rglob("*") if p.is_file()]
        raise FileNotFoundError(f"gtmodel comes with no file '{name}'{near(name, names)}")
    return path


_public(__name__)
