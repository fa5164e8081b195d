"""Forward kinematics of a model with other link lengths, through its own equations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...compiler.causal import CausalFunction
from ...compiler.rows import map_columns
from ...lang.source import ModelError
from ...results import Status
from .corners import Array


class ForwardWithLengths:
    """T from q and link lengths, by a closed-form CausalFunction whose parameters are left open.

    Args:
        forward: causal(known="q", targets="T") of the model.
        names: the parameters that are the link lengths, such as "L[0]".

    Raises ModelError where a name is no parameter of the model.
    """

    def __init__(self, forward: CausalFunction, names: Sequence[str]) -> None:
        known = forward.parameter_names
        for name in names:
            if name not in known:
                raise ModelError(f"'{name}' is no parameter of the model; there are {', '.join(known)}")
        self._function = forward.casadi_parametric
        self._values = np.asarray(forward.flat.require_values(), dtype=float).ravel()
        self._places = [known.index(name) for name in names]

    def __call__(self, q: Array, lengths: Array) -> tuple[Array, Array]:
        """T (n, 3) [m] of q (n, m) and lengths (n, 3) [m], and codes (n,): OUT_OF_RANGE where the links do not meet."""
        parameters = np.repeat(self._values[:, None], len(q), axis=1)
        parameters[self._places] = np.asarray(lengths, dtype=float).T
        position, status, _ = map_columns(self._function, [np.asarray(q, dtype=float).T, parameters])
        T, code = position.T, status[0].astype(int)
        T[code != Status.OK] = np.nan
        return T, code
