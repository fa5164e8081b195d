"""Options of a vibration study: the model, prior knowledge, synthetic data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from ..results.options import Options, Unit, Within

HELD_OUT = 1 / 3  # share of the samples, at the end, for validation only
LARGEST = 12  # default largest order: that of the largest model of Dressler 2012, section 6.3
BLOCK_ROWS = 20  # past and future each: cover some periods of the modes that a 4 ms loop can measure, at low cost
LONGEST = 25  # default longest delay in samples: 100 ms at 4 ms
MOST_MODES = 4  # default largest number of resonances


@dataclass(frozen=True)
class Subspace(Options):
    """How a state-space model is identified from a recording.

    >>> gt.vibration.Subspace(method="arx")
    Traceback (most recent call last):
    gtmodel...: method: expected one of moesp, n4sid, cva; found 'arx'
    """

    method: Annotated[Literal["moesp", "n4sid", "cva"], "how past and future are weighted"] = "moesp"
    order: Annotated[int | None, Within(least=1), "number of states; default: selected by held-out error"] = None
    largest_order: Annotated[int, Within(least=1), "largest order to try"] = LARGEST
    block_rows: Annotated[int, Within(least=2), "of past and future each"] = BLOCK_ROWS
    held_out: Annotated[float, Within(above=0.0, below=1.0), "share of the samples for validation only"] = HELD_OUT
    feedthrough: Annotated[bool, "whether the input acts on the output without delay"] = False


@dataclass(frozen=True)
class KnownMass(Options):
    """A known mass.

    >>> gt.vibration.KnownMass(coordinate=0, mass=30.0)  # coordinates count from 1
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: coordinate: must be at least 1; found 0
    """

    coordinate: Annotated[int, Within(least=1), "from 1"]
    mass: Annotated[float, Unit("kg"), Within(above=0.0), "its mass"]


@dataclass(frozen=True)
class Physical(Options):
    """The physical form M, D, K of a state-space model: prior knowledge.

    >>> by_force = gt.vibration.Physical(force_coordinates=[1])  # the input is a force [N] on the first position
    >>> by_mass = gt.vibration.Physical(mass=[gt.vibration.KnownMass(coordinate=1, mass=30.0)], refine=False)
    >>> by_mass.form
    'symmetric'
    """

    force_coordinates: Annotated[
        list[int], "coordinate on which each input acts in newtons, from 1; with force_N only"
    ] = field(default_factory=list)
    mass: Annotated[list[KnownMass], "one table for each known mass"] = field(default_factory=list)
    form: Annotated[
        Literal["symmetric", "free"], "symmetric: M, D, K positive definite by Cholesky factors; free: any D"
    ] = "symmetric"
    refine: Annotated[
        bool, "fit M, D, K to the recording by output error, with intervals; needs a force"
    ] = True  # fmt: skip


@dataclass(frozen=True)
class StepResponse(Options):
    """How a delayed first-order model is fitted to step responses.

    >>> gt.vibration.StepResponse(delay_samples=-1)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: delay_samples: must be at least 0; found -1
    """

    delay_samples: Annotated[int | None, Within(least=0), "default: the delay of least residual"] = None
    longest_samples: Annotated[int, Within(least=0), "longest delay to try"] = LONGEST


@dataclass(frozen=True)
class Impulse(Options):
    """How the resonances of a decay are fitted.

    >>> gt.vibration.Impulse(modes=0)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: modes: must be at least 1; found 0
    """

    modes: Annotated[
        int | None, Within(least=1), "number of resonances; default: selected by information criterion"
    ] = None  # fmt: skip
    largest: Annotated[int, Within(least=1), "largest number to try"] = MOST_MODES


@dataclass(frozen=True)
class Matrices(Options):
    """Printed matrices of M x'' + D x' + K x = f.

    >>> printed = gt.vibration.Matrices(M=[[2.0]], D=[[0.4]], K=[[200.0]], published=[1.6], published_digits=0.05)
    >>> [check.passed for check in gt.vibration.matrices_study(printed).checks.values()]
    [True]
    """

    M: Annotated[list[list[float]], Unit("kg"), "masses, row by row"]
    D: Annotated[list[list[float]], Unit("kg/s"), "damping"]
    K: Annotated[list[list[float]], Unit("N/m"), "stiffness"]
    published: Annotated[list[float], Unit("Hz"), Within(above=0.0), "modes printed with them, to be reproduced"] = (
        field(default_factory=list)
    )
    published_digits: Annotated[float, Unit("Hz"), Within(above=0.0), "half a unit of their last digit"] = 0.5


@dataclass(frozen=True)
class Sampling(Options):
    """How a synthetic recording of a known system is sampled, with its noise.

    >>> gt.vibration.Sampling(seed=1, noise=1e-6, samples=1)
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: samples: must be at least 2; found 1
    """

    seed: Annotated[int, Within(least=0), "seed of the noise and of the pseudo-random force"]
    noise: Annotated[float, Unit("m"), Within(least=0.0), "white noise on the positions, standard deviation"]
    samples: Annotated[int, Within(least=2), "of each recording"]
    sample_time: Annotated[float, Unit("s"), Within(above=0.0), "between samples"] = 0.004


@dataclass(frozen=True)
class SyntheticStructure(Options):
    """Masses, dampers and springs under a pseudo-random force.

    >>> from gtmodel.vibration import Sampling, SyntheticStructure, synthetic_records
    >>> structure = SyntheticStructure(M=[[2.0]], D=[[0.4]], K=[[200.0]], force=10.0)
    >>> (record,) = synthetic_records(structure, Sampling(seed=1, noise=1e-6, samples=100))
    >>> np.abs(record.u).max()  # N
    np.float64(10.0)
    """

    M: Annotated[list[list[float]], Unit("kg"), "masses, row by row"]
    D: Annotated[list[list[float]], Unit("kg/s"), "damping"]
    K: Annotated[list[list[float]], Unit("N/m"), "stiffness"]
    force: Annotated[float, Unit("N"), Within(above=0.0), "amplitude of the pseudo-random binary force"]
    coordinate: Annotated[int, Within(least=1), "on which it acts, from 1"] = 1
    hold_samples: Annotated[int, Within(least=1), "samples between changes: more shift the power down"] = 1


@dataclass(frozen=True)
class Steps(Options):
    """Steps of the reference through b q^-delay / (1 - a q^-1), one recording each.

    >>> gt.vibration.Steps(a=1.0, b=0.1, delay_samples=2, amplitudes=[1e-3])  # would never come to rest
    Traceback (most recent call last):
    gtmodel.results.refusal.ArgumentError: a: must be more than -1 and less than 1; found 1
    """

    a: Annotated[float, Within(above=-1.0, below=1.0), "pole"]
    b: Annotated[float, "numerator"]
    delay_samples: Annotated[int, Within(least=0), "delay"]
    amplitudes: Annotated[list[float], Unit("m"), "one step each"]
    rest_samples: Annotated[int, Within(least=1), "before the step"] = 25


@dataclass(frozen=True)
class Hit(Options):
    """Free decay after the hit of a hammer.

    >>> hit = gt.vibration.Hit(frequency=[7.4, 11.4], damping=[0.03, 0.03], amplitude=[[5e-4], [1e-4]])
    >>> (record,) = gt.vibration.synthetic_records(hit, gt.vibration.Sampling(seed=1, noise=0.0, samples=100))
    >>> record.y.shape, np.any(record.u)  # the force of a hit is not recorded
    ((100, 1), np.False_)
    """

    frequency: Annotated[list[float], Unit("Hz"), Within(above=0.0), "undamped, by mode"]
    damping: Annotated[list[float], Within(least=0.0), "ratio, by mode"]
    amplitude: Annotated[list[list[float]], Unit("m"), "by mode and measured position"]
