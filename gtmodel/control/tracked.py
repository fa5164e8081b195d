"""Simulations of a plant under a law along a reference, with their tracking errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmodel import lang as gt
from gtmodel.results import Trajectory
from gtmodel.results.trajectory import TIME_SLACK
from gtmodel.simulation import Simulation, simulate
from gtmodel.simulation.result import Progress

from .feedforward import Law
from .sampled_loop import sampled_loop
from .tracking_loop import tracking_loop


@dataclass(frozen=True, eq=False)
class Tracked:
    """What `track` returns: a motion under a law.

    trajectory: "reference", "position" and "forces" on the reference's rows, in SI units; forces that are held at
        samples are those before a sample at that instant. simulation: the run behind it.
    samples: of a law at samples what it read and computed at each; else None.
    """

    trajectory: Trajectory
    simulation: Simulation
    samples: Trajectory | None = None

    @property
    def error(self) -> np.ndarray:
        """(n, k) reference less position."""
        return self.trajectory["reference"] - self.trajectory["position"]

    @property
    def rms(self) -> np.ndarray:
        """(k,) root mean square of the error."""
        return np.sqrt(np.mean(self.error**2, axis=0))

    @property
    def largest(self) -> np.ndarray:
        """(k,) largest absolute value of the error at a row."""
        return np.max(np.abs(self.error), axis=0)


def track(
    plant: gt.Model,
    law: Law,
    reference: Trajectory,
    start: Mapping[str, Any],
    *,
    known: str = "q",
    targets: str = "tau",
    tolerance: float = 1e-7,
    period: float | None = None,
    progress: Progress | None = None,
    throw: bool = True,
    **sampled: Any,
) -> Tracked:
    """Simulate the plant along a reference under a law; returns a `Tracked`, with the tracking error.

    Args:
        plant: a model whose `known` and `targets` are vectors of equal length.
        law: `Feedforward`, `ComputedTorque`, `Feedback`, or a `Law` of your own.
        reference: holds the known variable at equal steps; between its rows it is a cubic spline.
        start: start values of the plant by its own names, e.g. {"T": [...], "der(T)": [0, 0, 0]}.
        known, targets: the actuators' positions and forces, by name.
        tolerance: of the integrator, see `simulate`.
        period: between two samples of the law [s]; None: it acts in continuous time.
        progress, throw: as of `simulate`; what ended early has fewer rows.
        sampled: further arguments of `sampled_loop` where a period is given: `delay`, 0.008 s if left out, `first`,
            `resolution`, `velocity`, `compiled`.

    Raises ModelError for a plant, law or start that does not fit, and NotSimulated.

    >>> class Cart(gt.Model):
    ...     m = gt.parameter(2.0, unit="kg", positive=True)
    ...     q = gt.variable(1, unit="m")
    ...     tau = gt.input(1, unit="N")
    ...     def equations(self):
    ...         yield self.m * gt.der(self.q, 2) == self.tau
    >>> t = np.linspace(0.0, 1.0, 101)
    >>> reference = gt.Trajectory(t, {"q": 3 * t[:, None] ** 2 - 2 * t[:, None] ** 3}, {"q": "m"})
    >>> for mass in (2.0, 1.0):  # as the law believes
    ...     law = gt.control.Feedforward(Cart(m=mass), stiffness=800.0, damping=80.0)
    ...     run = gt.control.track(Cart(), law, reference, {"q": [0.0], "der(q)": [0.0]})
    ...     print(bool(abs(run.error).max() > 1e-3))  # m
    False
    True

    The same at samples every 20 ms, which act 10 ms later:

    >>> law = gt.control.Feedforward(Cart(), stiffness=800.0, damping=80.0)
    >>> run = gt.control.track(Cart(), law, reference, {"q": [0.0], "der(q)": [0.0]}, period=0.02, delay=0.01)
    >>> run.largest.round(4), len(run.samples)
    (array([0.002]), 51)
    """
    rows = reference[known]
    table = Trajectory(reference.time, {"reference": rows}, {"reference": reference.unit(known)})
    if period is None and sampled:
        raise TypeError(f"track() takes {', '.join(sampled)} with a period only; a law in continuous time has none")
    if period is None:
        loop = tracking_loop(plant, law, known, targets)
    else:
        loop = sampled_loop(plant, law, period, known=known, targets=targets, **sampled)
    run = simulate(
        loop,
        float(reference.time[-1]),
        start_time=float(reference.time[0]),
        inputs={"reference": (table, "cubic")},
        start={_inside(name): value for name, value in start.items()},
        step=float(reference.time[1] - reference.time[0]),
        outputs=[f"plant.{known}", f"plant.{targets}"],
        tolerance=tolerance,
        progress=progress,
        throw=throw,
    )
    simulated = run.trajectory
    time = reference.time[reference.time <= simulated.time[-1] * (1 + TIME_SLACK)]
    rows = rows[: len(time)]
    q, tau = (np.column_stack([simulated(time, f"plant.{n}[{k}]") for k in range(rows.shape[1])])
              for n in (known, targets))  # fmt: skip
    names = {"reference": (rows, reference.unit(known)), "position": (q, reference.unit(known)),
             "forces": (tau, simulated.unit(f"plant.{targets}"))}  # fmt: skip
    note = "; ".join(n for n in (reference.synthetic, "simulated closed loop, no noise") if n)
    trajectory = Trajectory(
        time, {n: v for n, (v, _) in names.items()}, {n: u for n, (_, u) in names.items()}, synthetic=note
    )
    return Tracked(trajectory, run, run.samples.get("law"))


def _inside(name: str) -> str:
    """A plant's own name, "T" or "der(T,2)", seen from the loop."""
    return f"der(plant.{name[4:]}" if name.startswith("der(") else f"plant.{name}"
