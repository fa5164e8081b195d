"""The assembly modes of one pose, as handed back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...geometry.rotations import angle_between
from ...results.status import ModesStatus
from .certificate import Certificate
from .platform import Real


@dataclass(frozen=True)
class AssemblyModes:
    """All assembly modes of a platform on six legs of given lengths.

    A platform joint B stands at T + R B in the frame of the base joints. Lengths are in the unit of the input.

    Attributes:
        status: whether the set is whole.
        message: the same in a sentence with numbers.
        R: attitudes of the m real modes, (m, 3, 3).
        T: their positions, (m, 3). The modes are sorted by the place of the platform joints' centroid, by x, then y,
            then z, with differences below 1e-9 of the size ignored.
        quaternion: their attitudes as unit quaternions, (m, 4), scalar first, first nonzero entry positive.
        nearest_other: (m,) index of the real mode nearest each, -1 when it is the only one. Near means least
            root of (distance / size)^2 + angle^2, with the distance between the centroids of the platform joints.
        nearest_distance: (m,) that distance, in the unit of the input; infinite when there is no other.
        nearest_angle_deg: (m,) and the angle [deg].
        R_complex: all k finite modes, the real ones first in the order of R, then pairs of conjugates;
            (k, 3, 3) complex with R R' = 1.
        T_complex: (k, 3) complex.
        infinite: directions x of the modes at infinity as complex quaternions with x.x = 0, |x| = 1, (j, 4).
        R_multiple: one for each finite mode where the equations are singular, (l, 3, 3), complex in general.
        T_multiple: (l, 3); known to about half the digits only.
        size: length that the legs were divided by.
        certificate: the evidence.
    """

    status: ModesStatus
    message: str
    R: Real
    T: Real
    quaternion: Real
    nearest_other: NDArray[np.intp]
    nearest_distance: Real
    nearest_angle_deg: Real
    R_complex: NDArray[np.complex128]
    T_complex: NDArray[np.complex128]
    infinite: NDArray[np.complex128]
    R_multiple: NDArray[np.complex128]
    T_multiple: NDArray[np.complex128]
    size: float
    certificate: Certificate

    @property
    def ok(self) -> bool:
        """True when all finite modes are known and isolated."""
        return self.status.ok

    def nearest(self, R: ArrayLike, T: ArrayLike) -> tuple[int, float, float]:
        """The real mode nearest a pose R (3, 3), T (3,): its index, distance in the input's unit, angle [deg].

        Near as for `nearest_other`, but with the distance between the two T. Index -1 and infinite distances when
        there are no real modes.
        """
        if not len(self.T):
            return -1, np.inf, np.inf
        distance = np.linalg.norm(self.T - np.asarray(T, dtype=float), axis=1)
        angle = angle_between(self.R, np.asarray(R, dtype=float))
        k = int(np.argmin((distance / self.size) ** 2 + angle**2))
        return k, float(distance[k]), float(np.degrees(angle[k]))


def without_modes(status: ModesStatus, message: str, size: float, certificate: Certificate) -> AssemblyModes:
    """A result that holds no modes, only its status."""
    R, T = np.zeros((0, 3, 3)), np.zeros((0, 3))
    Rc, Tc, none = R.astype(complex), T.astype(complex), np.zeros(0)
    return AssemblyModes(
        status, message, R, T, np.zeros((0, 4)), np.zeros(0, dtype=np.intp), none, none,
        Rc, Tc, np.zeros((0, 4), dtype=complex), Rc, Tc, size, certificate,
    )  # fmt: skip
