"""The package python-control, for the modules that make its systems: here they learn to pickle."""

import copyreg
from typing import Any

import control

_OF_ITS_OWN = ("updfcn", "outfcn")  # lambdas that a StateSpace makes of its matrices


def _again(name: str, *matrices: Any) -> Any:
    return control.StateSpace(*matrices, name=name)


def _parts(system: Any) -> tuple[Any, ...]:
    state = {key: value for key, value in vars(system).items() if key not in _OF_ITS_OWN}
    return _again, (system.name, system.A, system.B, system.C, system.D, system.dt), state


copyreg.pickle(control.StateSpace, _parts)
