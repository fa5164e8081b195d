"""Certificates: what holds at every point of a box, proved by interval arithmetic over the operations of a function.

study            prove status, bounds of outputs, regularity and round-off over a box: a `BoxCertificate`
BoxCertificate   the result: proved, refuted and undecided share, claims, counter-examples, error bounds
InputSpeed       motion of the inputs between two calls, for code with Newton's method
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .certificate import BoxCertificate as BoxCertificate, InputSpeed as InputSpeed
    from .certificate_study import study as study

public(__name__)
