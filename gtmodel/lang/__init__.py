"""The modelling language: models, variables, equations, connections and optimisation problems."""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .builder import Builder as Builder
    from .condition import Condition as Condition
    from .connect import (
        Branch as Branch,
        Connection as Connection,
        Energy as Energy,
        JointConstraint as JointConstraint,
        Loops as Loops,
        TreeEdge as TreeEdge,
        between as between,
        branch as branch,
        connect as connect,
        constraint as constraint,
        energy as energy,
        loops as loops,
        tree_edge as tree_edge,
        tree_root as tree_root,
    )
    from .declare import (
        discrete as discrete,
        each as each,
        flow as flow,
        free as free,
        input as input,
        outer as outer,
        output as output,
        parameter as parameter,
        part as part,
        parts as parts,
        port as port,
        ports as ports,
        potential as potential,
        variable as variable,
    )
    from .events import (
        EnergyLoss as EnergyLoss,
        If as If,
        Reinit as Reinit,
        SampledBlock as SampledBlock,
        When as When,
        energy_loss as energy_loss,
        initial as initial,
        pre as pre,
        reinit as reinit,
        sample as sample,
        terminate as terminate,
        when as when,
    )
    from .expression import Expr as Expr, Relation as Relation, vector as vector
    from .external import External as External, external as external
    from .functions import (
        absolute as absolute,
        acos as acos,
        asin as asin,
        atan as atan,
        atan2 as atan2,
        clip as clip,
        cos as cos,
        cross as cross,
        der as der,
        dot as dot,
        exp as exp,
        log as log,
        maximum as maximum,
        minimum as minimum,
        norm as norm,
        sign as sign,
        sin as sin,
        sqrt as sqrt,
        tan as tan,
        tanh as tanh,
    )
    from .interpolation import interpolate as interpolate, piecewise as piecewise
    from .model import Connector as Connector, Model as Model
    from .optimization import Optimization as Optimization, delayed as delayed, integral as integral, misfit as misfit
    from .source import ModelError as ModelError, SourceLocation as SourceLocation
    from .units import UnitError as UnitError

public(__name__)
