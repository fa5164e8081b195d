"""What an identification is asked for, carried from the study's call to its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..compiler.causal import flat_of
from ..lang import Model, ModelError
from ..results import ArgumentError, Work, naming
from .options import Fitting, Processing
from .parameter_names import ParameterError, among, scalar_parameters
from .regressor import Regressor


@dataclass(frozen=True, eq=False)
class Asked:
    """What is free and how it is fitted, the regressor of what is free and watched, numbers to compare with."""

    robot: Model
    free: Sequence[str]
    how: Fitting
    processing: Processing
    regressor: Regressor
    published: Mapping[str, float]
    title: str
    work: Work

    @property
    def nonnegative(self) -> bool | list[str]:
        """What must not be negative; base parameters may be."""
        if self.how.inertias is None or self.how.nonnegative is not True:
            return self.how.nonnegative
        return [n for n in self.regressor.names if n not in self.regressor.base]

    @property
    def names(self) -> tuple[str, str]:
        """Of the known variable and of the efforts."""
        return self.how.known, self.how.targets


def asked_for(
    robot: Model,
    free: Sequence[str],
    fitting: Fitting | None,
    processing: Processing | None,
    published: Mapping[str, float] | None,
    title: str,
    work: Work,
) -> Asked:
    """From the arguments of a study. Raises ArgumentError."""
    how = fitting or Fitting()
    regressor = regressor_of(robot, free, how)
    for name in published or {}:
        with naming(f"published.{name}", ModelError):
            scalar_parameters(flat_of(robot), [name])
    work.progress("reading", 0.1)
    return Asked(
        robot, free_of(regressor, free, how), how, processing or Processing(), regressor, published or {}, title, work
    )


def regressor_of(robot: Model, free: Sequence[str], how: Fitting) -> Regressor:
    """The regressor of what is free and what is watched. Raises ArgumentError."""
    for argument, names in (("known", [how.known]), ("targets", [how.targets]), ("inputs", how.inputs)):
        for name in names:
            with naming(f"fitting.{argument}", ModelError):
                flat_of(robot).lookup(name)
    known = [how.known, *how.inputs]
    if how.inertias is not None and how.watch:
        raise ArgumentError("is not for inertias, of which all that can be determined is free", "fitting.watch")
    try:
        if how.inertias is not None:
            from .base_parameters import BaseRegressor  # here: most identifications are not of arms

            regressor = BaseRegressor(robot, free, known, how.targets)
        else:
            regressor = Regressor(robot, [*free, *how.watch], known, how.targets)
    except ParameterError as error:
        watched = {error.parameter, error.parameter.partition("[")[0]} & set(how.watch)
        raise ArgumentError(str(error), "fitting.watch" if watched else "free") from error
    except ModelError as error:
        raise ArgumentError(str(error), "free") from error
    if not isinstance(how.nonnegative, bool):
        with naming("fitting.nonnegative", ModelError):
            among(regressor.names, how.nonnegative)
    return regressor


def free_of(regressor: Regressor, free: Sequence[str], how: Fitting) -> Sequence[str]:
    """What is estimated: the names that were given, and base parameters where inertias are asked for."""
    return free if how.inertias is None else regressor.names
