"""Problem kinds: the only modules that combine robots and engines. Each kind is a module that turns the keys of a file
into options of a study and into its call. It defines

    Schema    a `Problem` subclass: every key of the file with a description, and its unit in its name
    RESULT    dotted name of the result class, whose quantities are ``values``; several if tables of the file choose
    ARGUMENTS keys of the study's arguments, if they differ from the argument's name: "map" -> "section";
              a function `arguments` (problem) if they depend on the problem
    call      (problem, context) -> Call
    explain   optional: (problem, context) -> str

A kind accesses engines only at use, as `compliance.study`, so that its schema imports none. A kind that is a folder has
the first two names in keys.py and the others in kind.py.

`names` lists the kinds with one line each, `get` imports a kind, `schema_of` and `results_of` import its schema and
result classes without its engines.
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
    "axis_trajectory": "optimal motion of the F1 between two positions of its carts and rotary axes",
    "arm_trajectory": "optimal motion of a serial arm through waypoints, with distances of its links kept",
    "trajectory_table": "several optimal motions of a robot, compared with published numbers",
    "codegen": "C code of a robot's functions",
    "optimization": "a dynamic optimisation problem written in Python",
    "simulation": "motion of a robot under given inputs, from a given start",
    "loop_simulation": "motion of a robot under a sampled control law with delay",
    "delayed_feedback": "largest gain of delayed corrections from an external sensor, and the stability margins",
    "modes": "all poses in which six links of given lengths can be assembled, with a certificate",
    "postures": "all postures of a serial arm for a pose, a table of poses or a path, within its joint limits",
    "certificate": "proof over a whole box: a solution everywhere, limits, no singular pose, bounds of round-off",
    "kinematics": "any causality of a robot at many points, and the orientation of its plate",
    "workspace": "tool centre points that a robot reaches: cross-section, boundary, volume, reasons",
    "excitation": "the motion that identifies masses and friction best, within limits",
    "identification": "masses and friction of a robot from its measured motion and forces",
    "calibration_plan": "poses to measure for a calibration, and its expected accuracy",
    "accuracy": "positioning errors of a robot from errors of its carts and links",
    "dynamic_stiffness": "mass, damping and stiffness of an arm over its poses from frequency responses",
    "elastic_motion": "vibration of an elastic tool after optimal motions: planned rigid, shaped, planned elastic",
    "compliance": "stiffness, deflection and natural frequencies of a robot over its workspace, from its springs",
    "calibration": "geometric parameters of a robot from measured poses, or joint stiffness from loads, with errors",
    "stereo": "lens parameters and poses of cameras from the corners of a board in their images, with errors",
    "robot_cameras": "joint calibration of a robot and its cameras; placement of two cameras",
    "vibration": "step-response, subspace and impulse models of a log; M, D, K and modes",
    "milling": "angle about the spindle for milling: static and dynamic deflection, chatter, compensation",
    "resampling": "signals of several clocks on one even grid: uneven rows, gaps, offset and drift of the clocks",
    "delay": "delays between signals that show the same motion, with confidence intervals",
    "filtering": "Kalman filter and smoother over a log, with any model as process, and consistency tests",
    "sensor_fusion": "motion estimated from laser tracker and inertial unit, with consistency tests of the filter",
    "lead_through": "hand guiding with two force sensors: contact force, limits, energy at the handle, peg in hole",
    "wrench_calibration": "bias, mass and centre of mass of the load on a force sensor, from poses, with intervals",
    "learning_control": "iterative learning control: predicted rate and floor, simulated runs, the next input",
    "friction": "friction of carts that carry a plate, and the mass that they carry, from constant-velocity runs",
}


def names() -> dict[str, str]:
    """Return the kinds of problem, each with one line."""
    return dict(_KINDS)


def get(name: str) -> Kind:
    """Return the kind of that name. Raises InputError with close matches."""
    # a module that is a Kind
    return _module(name, "kind")  # type: ignore[return-value]


def schema_of(name: str) -> type[Problem]:
    """Return the schema of a kind. Raises InputError with close matches."""
    return _defined(name, "Schema")


def results_of(name: str) -> list[type[Study]]:
    """Return the result classes of a kind. Raises InputError with close matches."""
    places, classes = _defined(name, "RESULT"), []
    for place in [places] if isinstance(places, str) else places:
        package, _, study = place.rpartition(".")
        if not hasattr(library := import_module(package), study):
            own = _file(_module(name, "keys"))
            raise InputError(f"{own}: RESULT names {place}, which {_file(library)} does not export")
        classes.append(getattr(library, study))
    return classes


def _defined(kind: str, name: str) -> Any:
    module = _module(kind, "keys")
    if not hasattr(module, name):
        raise InputError(f"{_file(module)} defines no {name}; the registry's docstring lists the names of a kind")
    return getattr(module, name)


def _file(module: Any) -> str:
    return f"{module.__name__.replace('.', '/')}{'/__init__' if hasattr(module, '__path__') else ''}.py"


def _module(name: str, file: str) -> Any:
    if name not in _KINDS:
        hint = meant(name, _KINDS, f"there are {', '.join(_KINDS)}")
        raise InputError(f"there is no kind '{name}'; {hint}")
    kind = import_module(f"gtmodel.kinds.{name}")
    return import_module(f"gtmodel.kinds.{name}.{file}") if hasattr(kind, "__path__") else kind
