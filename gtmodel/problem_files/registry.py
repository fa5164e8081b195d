"""Problem kinds: the only place where robots and engines meet. A module per kind, from
the keys of the file by options of the study to its call. It holds

    Schema    a `Problem` subclass: every key of the file, described, its unit in its name
    RESULT    the class of its study by name, whose quantities ``values`` will hold; several where tables choose
    NAME      its name in a problem file, ``kind = "..."``
    ARGUMENTS where the study's arguments stand in the file, if not under their own names: "map" -> "section";
              a function `arguments` (problem) where that depends on the problem
    call      (problem, context) -> Call
    explain   optional: (problem, context) -> str

What computes is looked up when it is used, `compliance.study`, so that the schema imports no engine. A folder in place
of a module has the first two in keys.py and the rest in kind.py.

`names` lists the kinds with one line each, `get` imports one, `schema_of` and `results_of` what it takes and gives
without what it computes with; nothing else is imported before it is needed.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .._near import meant
from .files import InputError

if TYPE_CHECKING:
    from gtmodel.results import Study

    from .base import Kind, Problem

_KINDS = {
    "trajectory": "time- or energy-optimal motion of a robot between two poses",
    "axis_trajectory": "optimal motion of the F1 between two positions of its axes, carts and rotary ones",
    "trajectory_table": "several such motions beside published numbers",
    "codegen": "C code of a robot's functions",
    "optimization": "a dynamic optimisation problem written in Python",
    "simulation": "motion of a robot under given inputs, from a given start",
    "loop_simulation": "motion of a robot under a control law that computes at samples, with delay",
    "delayed_feedback": "how far late corrections from an external sensor may be turned up, and its margins",
    "modes": "all poses in which six links of given lengths can be assembled, with a certificate",
    "kinematics": "any causality of a robot on many points, and the orientation of its plate",
    "workspace": "which tool centre points a robot reaches: cross-section, boundary, volume, reasons",
    "excitation": "the motion from which masses and friction are identified best, within limits",
    "identification": "masses and friction of a robot from its measured motion and forces",
    "calibration_plan": "which poses to measure for a calibration, and what it will then be worth",
    "accuracy": "positioning errors of a robot from errors of its carts and links",
    "dynamic_stiffness": "mass, damping and stiffness of an arm over its poses from frequency responses",
    "elastic_motion": "how an elastic tool swings after optimal motions: planned rigid, shaped, and planned elastic",
    "compliance": "stiffness, deflection and natural frequencies of a robot over its workspace, from its springs",
    "calibration": "geometric parameters of a robot from measured poses, or joint stiffness from loads, with errors",
    "stereo": "lenses of cameras and where these stand, from corners of a board in their pictures, with errors",
    "robot_cameras": "a robot and its cameras calibrated together; where two cameras should stand",
    "vibration": "step-response, subspace and impulse models of a log; M, D, K and modes",
    "milling": "where to mill: the angle about the spindle by static and dynamic deflection, chatter, compensation",
    "resampling": "signals of several clocks on one even grid: uneven rows, gaps, offset and drift of the clocks",
    "delay": "how late signals come behind others that show the same motion, with intervals",
    "filtering": "any model as the process of a filter, with sensors over a log: estimates and whether to believe them",
    "sensor_fusion": "laser tracker and inertial unit filtered into one motion, and whether to believe the filter",
    "lead_through": "a tool guided by hand with two force sensors: force held, limits, energy at the handle, a peg",
    "wrench_calibration": "bias, mass and centre of what a force sensor carries, from poses, with intervals",
    "learning_control": "what a robot that repeats a motion learns: rate and floor said before, runs, the next input",
    "friction": "friction of the actuators and the mass they hold, from constant-velocity runs",
}


def names() -> dict[str, str]:
    """The kinds of problem, each with one line."""
    return dict(_KINDS)


def get(name: str) -> Kind:
    """The kind of that name. Raises InputError with close matches."""
    # a module that is a Kind
    return _module(name, "kind")  # type: ignore[return-value]


def schema_of(name: str) -> type[Problem]:
    """What its files hold. Raises InputError with close matches."""
    return _module(name, "keys").Schema


def results_of(name: str) -> list[type[Study]]:
    """The classes of what it may answer. Raises InputError with close matches."""
    named = _module(name, "keys").RESULT
    places = [place.rpartition(".") for place in ([named] if isinstance(named, str) else named)]
    return [getattr(import_module(library), study) for library, _, study in places]


def _module(name: str, file: str) -> Any:
    if name not in _KINDS:
        hint = meant(name, _KINDS, f"there are {', '.join(_KINDS)}")
        raise InputError(f"there is no kind '{name}'; {hint}")
    kind = import_module(f"gtmodel.kinds.{name}")
    return import_module(f"gtmodel.kinds.{name}.{file}") if hasattr(kind, "__path__") else kind
