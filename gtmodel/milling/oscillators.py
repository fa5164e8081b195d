"""Tool dynamics as three decoupled oscillators m x'' + c x' + k x = F, Cvitanic 2021, eq. (8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..results import ArgumentError


@dataclass(frozen=True, eq=False)
class Oscillators:
    """Dynamics of the tool in n poses: m [kg], c [N.s/m], k [N/m], each (n, 3) along x, y, z of the world, all
    positive.

    A single pose may have the shape (3,). Raises ArgumentError for values that are not positive or a wrong shape.

    >>> robot = gt.milling.Oscillators(m=[350, 350, 250], c=[1500, 1500, 1000], k=[2e6, 1.5e6, 3e6])
    >>> robot.frequency.round(1), robot.damping_ratio.round(3)  # [Hz], [1]
    (array([[12. , 10.4, 17.4]]), array([[0.028, 0.033, 0.018]]))
    """

    m: np.ndarray
    c: np.ndarray
    k: np.ndarray

    def __post_init__(self) -> None:
        for name, unit in (("m", "kg"), ("c", "N.s/m"), ("k", "N/m")):
            value = np.atleast_2d(np.asarray(getattr(self, name), float))
            if value.ndim != 2 or value.shape[1] != 3 or len(value) != len(np.atleast_2d(self.m)):
                raise ArgumentError(f"has the shape {value.shape}; expected (n, 3), x, y and z of n poses", name)
            if not np.all(value > 0) or not np.all(np.isfinite(value)):
                pose, axis = np.argwhere(~((value > 0) & np.isfinite(value)))[0]
                raise ArgumentError(
                    f"is {value[pose, axis]:g} {unit} along {'xyz'[axis]} in pose {pose}; expected a positive number",
                    name,
                )
            object.__setattr__(self, name, value)

    @classmethod
    def with_damping_ratio(cls, m: ArrayLike, k: ArrayLike, zeta: ArrayLike) -> Oscillators:
        """Return oscillators from m [kg], k [N/m] and damping ratios zeta [1], each (n, 3)."""
        m, k = np.asarray(m, float), np.asarray(k, float)
        return cls(m, 2 * np.asarray(zeta, float) * np.sqrt(m * k), k)

    def __len__(self) -> int:
        return len(self.m)

    def __getitem__(self, rows: int | slice | np.ndarray) -> Oscillators:
        return Oscillators(self.m[rows], self.c[rows], self.k[rows])

    @property
    def frequency(self) -> np.ndarray:
        """Undamped natural frequencies sqrt(k/m)/2pi (n, 3) [Hz]."""
        return np.sqrt(self.k / self.m) / (2 * np.pi)

    @property
    def damping_ratio(self) -> np.ndarray:
        """Damping ratios c / (2 sqrt(k m)) (n, 3) [1]."""
        return self.c / (2 * np.sqrt(self.k * self.m))

    def shifted(self, hertz: float) -> Oscillators:
        """Return oscillators with natural frequencies changed by `hertz`, with unchanged stiffness and damping ratio.

        Raises ValueError if a frequency would not be positive.
        """
        f = self.frequency + hertz
        if np.any(f <= 0):
            raise ValueError(f"a shift of {hertz:g} Hz leaves no positive natural frequency; the lowest is "
                             f"{self.frequency.min():.3g} Hz")  # fmt: skip
        return Oscillators.with_damping_ratio(self.k / (2 * np.pi * f) ** 2, self.k, self.damping_ratio)

    def receptance(self, omega: ArrayLike) -> np.ndarray:
        """Return the receptance H = 1 / (k - m w^2 + j c w) (n, w, 3) [m/N] at frequencies omega (w,) [rad/s]."""
        w = np.asarray(omega, float).reshape(1, -1, 1)
        m, c, k = (x[:, None, :] for x in (self.m, self.c, self.k))
        return 1 / (k - m * w**2 + 1j * c * w)

    @classmethod
    def concatenate(cls, parts: list[Oscillators]) -> Oscillators:
        """Return the poses of all parts in one object."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("m", "c", "k")))


def missing_z(m: ArrayLike, c: ArrayLike, k: ArrayLike) -> Oscillators:
    """Return oscillators (n, 3) if c_z is missing, as in Cvitanic 2021, Table 16: zeta_z is the mean of zeta_x and
    zeta_y.

    >>> robot = gt.milling.missing_z(m=[350, 350, 250], c=[1000, 1500, 0], k=[2e6, 1.5e6, 3e6])
    >>> robot.damping_ratio.round(3)
    array([[0.019, 0.033, 0.026]])
    """
    m, c, k = (np.atleast_2d(np.asarray(x, float)) for x in (m, c, k))
    zeta = c / (2 * np.sqrt(m * k))
    zeta = np.column_stack([zeta[:, :2], zeta[:, :2].mean(axis=1)])
    return Oscillators.with_damping_ratio(m, k, zeta)
