"""Serial chains: axes as lines, closed forms found from them, all postures of a pose."""

from .chain import Chain as Chain
from .closed import (
    BranchSign as BranchSign,
    ClosedForm as ClosedForm,
    Expressions as Expressions,
    closed_form as closed_form,
)
