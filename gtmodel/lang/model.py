"""Model and Connector: classes with declarations in the body and physics in equations()."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from .._near import meant, near
from .._pickling import Interned, Portable
from . import functions as _functions  # noqa: F401  # fills UFUNCS: NumPy on the left of an expression
from .declarations import Declaration, Discrete, Each, Free, Outer, Parameter, Part, Port, Variable
from .declare import ATTRIBUTES, variable
from .expression import Expr
from .source import ModelError, SourceLocation, here
from .values import check_parameter


class EngineMethod:
    """A method implemented by a function of another module, which is imported on first access."""

    def __init__(self, module: str, function: str) -> None:
        self._module, self._function = module, function

    def __get__(self, model: Any, owner: type) -> Callable[..., Any]:
        function = getattr(import_module(self._module), self._function)
        return function if model is None else function.__get__(model, owner)


class Model(Interned):
    """Base class of components and of whole models: declarations in the class body, physics in `equations()`.

    The body declares with gt.variable, input, parameter, part, parts, port, ports and outer. `equations()` yields
    equations `a == b`, in any order and not solved for any variable, connections, branches and energies. In it
    `self.name` is the expression, part or port of that name.

    `Rod(L=2.0)` is an immutable configuration: a class and its modifiers. Modifiers are values of parameters,
    attributes of variables (`x={"start": 0.2}`) and modifiers of parts (`arm={"L": 2.0}`). `causal` computes targets
    from known variables, `simulate` computes the motion, `with_` returns a variant. All errors of a model are
    ModelError, with file and line.

    >>> class Pendulum(gt.Model):  # a point mass on a rod, in Cartesian coordinates, y upwards
    ...     L = gt.parameter(1.0, unit="m", positive=True)
    ...     m = gt.parameter(1.0, unit="kg", positive=True)
    ...     g = gt.parameter(9.81, unit="m/s2")
    ...     x = gt.variable(unit="m", start=0.6)
    ...     y = gt.variable(unit="m", start=-0.8)
    ...     pull = gt.variable(unit="N/m", description="of the rod, per length")
    ...     torque = gt.input(unit="N.m", description="of the motor, counter-clockwise")
    ...     def equations(self):
    ...         drive = self.torque / self.L**2
    ...         yield self.x**2 + self.y**2 == self.L**2
    ...         yield self.m * gt.der(self.x, 2) == -self.pull * self.x - drive * self.y
    ...         yield self.m * gt.der(self.y, 2) == -self.pull * self.y + drive * self.x - self.m * self.g
    >>> pendulum = Pendulum(m=2.0)
    >>> pendulum.causal(known="x", targets="y")(0.6)
    (-0.8, <Status.OK: 0>)
    >>> hold = pendulum.causal(known="x", targets="torque")  # a function of x, der(x), der(x,2)
    >>> torque, status = hold(0.6, 0.0, 0.0)
    >>> round(torque, 3)  # m g x
    11.772
    >>> swing = pendulum.causal(known="torque", targets="der(x,2)", prefer="x")
    >>> [signal.name for signal in swing.inputs]  # the states, then the known variables
    ['x', 'der(x)', 'torque']
    >>> run = pendulum.simulate(1.0, inputs={"torque": 0.0}, start={"x": 0.6, "der(x)": 0.0})
    >>> run.status.ok
    True
    """

    _declared: ClassVar[dict[str, Declaration]] = {}
    _notes: ClassVar[tuple[str, ...]] = ()  # sentences for the results, from the translation of Modelica text
    _path: str
    _values: dict[str, Any]
    causal = EngineMethod("gtmodel.compiler.causal", "compile_causal")
    simulate = EngineMethod("gtmodel.simulation.run", "simulate")
    mobility = EngineMethod("gtmodel.kinematics.mobility", "mobility")

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        declared: dict[str, Declaration] = {}
        for base in reversed(cls.__mro__):
            for name, item in vars(base).items():
                if isinstance(item, Declaration):
                    declared[name] = item
                elif isinstance(declared.get(name), Free):
                    del declared[name]
                elif name in declared:
                    raise ModelError(f"'{name}' in {cls.__name__} hides a declaration of the same name; rename it")
        for name, item in vars(cls).items():
            if isinstance(item, Model) and "where" in item.__dict__:
                advice = f"write {name} = gt.part({type(item).__name__}, ...)"
                raise ModelError(f"'{name}' is not declared as a part; {advice}", item.__dict__["where"])
        for name, item in declared.items():
            if name.startswith("_"):
                raise ModelError(f"declared names must not start with an underscore; found '{name}'", item.where)
            if name in _RESERVED:
                raise ModelError(f"'{name}' is an attribute of every model; choose another name", item.where)
        cls._declared = declared

    def __init__(self, **modifiers: Any) -> None:
        self.__dict__["where"] = here()
        self.__dict__["_modifiers"] = {name: _frozen(value) for name, value in modifiers.items()}
        check_modifiers(type(self), modifiers, here())

    def _recipe(self, pickler: Any) -> tuple[Any, ...]:
        return _configured, (type(self), self.__dict__["_modifiers"], self.__dict__["where"])

    def _reduced(self, pickler: Any) -> tuple[Any, ...]:
        if "_modifiers" in self.__dict__:
            return super()._reduced(pickler)
        scope = self.__dict__.get("_scope")
        if scope is None or not scope.is_owned or scope is pickler.inside:
            return Portable._reduced(self, pickler)
        return _component, (scope, self._path)  # a component of a flattened model

    def __reduce_ex__(self, protocol: Any) -> tuple[Any, ...]:
        return (Interned if "_modifiers" in self.__dict__ else Portable).__reduce_ex__(self, protocol)

    def _keep(self, **values: Any) -> None:
        """Store an engine's data with a model; they are not part of the configuration."""
        self.__dict__.update(values)

    def __setattr__(self, name: str, value: Any) -> None:
        raise ModelError(f"models are immutable: '{name}' cannot be assigned; use model.with_({name}=...)", here())

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # looked up by Python or NumPy, such as __array__
            raise AttributeError(f"'{type(self).__name__}' has no attribute '{name}'")
        raise AttributeError(f"{type(self).__name__} has no declaration '{name}'{near(name, type(self)._declared)}")

    def __delattr__(self, name: str) -> None:
        raise ModelError(f"models are immutable: '{name}' cannot be deleted", here())

    def _member(self, item: Declaration) -> Any:
        values = self.__dict__.get("_values")
        if values is not None:
            if item.name not in values:
                raise ModelError(f"'{item.name}' is used before it is declared", item.where)
            return values[item.name]
        if isinstance(item, Parameter):
            return self.__dict__["_modifiers"].get(item.name, item.default)
        return self.__dict__["_modifiers"].get(item.name, item)

    @property
    def time(self) -> Any:
        """The time [s] as an expression, inside equations()."""
        return self.__dict__["_time"]

    def with_(self, **modifiers: Any) -> Any:
        """Return a new model with some modifiers replaced; this one stays unchanged.

        A dictionary, for a part or for a variable's attributes, replaces the entries it names and keeps the others.

        >>> class Rod(gt.Model):
        ...     L = gt.parameter(1.0, unit="m")
        ...     x = gt.variable(unit="m", start=0.6)
        >>> Rod(L=2.0, x={"min": 0.0}).with_(L=3.0, x={"max": 1.0})
        Rod(L=3.0, x={'min': 0.0, 'max': 1.0})
        """
        return type(self)(**_merged(self.__dict__["_modifiers"], modifiers))

    def _apart_from(self, names: Iterable[str]) -> tuple[Model, dict[str, Any]]:
        """Return the model without the modifiers of these names, such as "arm.m", and their values by name."""
        rest, values = self.__dict__["_modifiers"], dict[str, Any]()
        for name in names:
            rest, value = _without(rest, name.split("."))
            if value is not None:
                values[name] = value
        return type(self)(**rest), values

    def equations(self) -> Iterable[Any]:
        """Yield equations (`a == b`), connections, branches and energies; `super().equations()` yields the base's."""
        return ()

    def initial_equations(self) -> Iterable[Any]:
        """Yield equations that hold only at the start time, such as `der(self.x) == 0` for a start at equilibrium."""
        return ()

    def __repr__(self) -> str:
        modifiers = ", ".join(f"{k}={v!r}" for k, v in self.__dict__.get("_modifiers", {}).items())
        return f"{type(self).__name__}({modifiers})"


def _configured(cls: type[Model], modifiers: dict[str, Any], where: SourceLocation) -> Model:
    model = object.__new__(cls)
    model._keep(where=where, _modifiers=modifiers)
    return model


def _component(scope: Any, path: str) -> Model:
    """Return a bound component, port or part of the model that a scope belongs to."""
    tree = scope.source.tree
    everything = [tree.root, *tree.components, *tree.ports, *tree.inner_defaults.values()]
    return next(c for c in everything if c._path == path)


class Connector(Model):
    """A set of potentials and flows by which components are connected; declare it once, use it as `gt.port(Pin)`.

    Potentials of connected ports are equal and their flows sum to zero. A flow is positive into its component.

    A potential with more numbers than degrees of freedom, such as a rotation matrix, must not be connected in a loop.
    Such a class sets `overdetermined` to the reason, which errors quote, and its components declare with gt.tree_edge
    and gt.tree_root which port determines which. If `overdetermined` is empty, loops are allowed.

    >>> class Flange(gt.Connector):
    ...     s = gt.potential(unit="m")
    ...     f = gt.flow(unit="N")
    >>> class Spring(gt.Model):
    ...     k = gt.parameter(unit="N/m", positive=True)
    ...     a = gt.port(Flange)
    ...     b = gt.port(Flange)
    ...     def equations(self):
    ...         yield self.b.f == self.k * (self.b.s - self.a.s)
    ...         yield self.a.f + self.b.f == 0
    >>> class Wall(gt.Model):
    ...     flange = gt.port(Flange)
    ...     def equations(self):
    ...         yield self.flange.s == 0
    >>> class Hand(gt.Model):
    ...     flange = gt.port(Flange)
    ...     force = gt.variable(unit="N")
    ...     def equations(self):
    ...         yield self.flange.f == -self.force
    >>> class Row(gt.Model):  # two springs in series
    ...     wall = gt.part(Wall)
    ...     springs = gt.parts(2, Spring, k=[100.0, 300.0])
    ...     hand = gt.part(Hand)
    ...     def equations(self):
    ...         yield gt.connect(self.wall.flange, self.springs[0].a)
    ...         yield gt.connect(self.springs[0].b, self.springs[1].a)
    ...         yield gt.connect(self.springs[1].b, self.hand.flange)
    >>> stretch = Row().causal(known="hand.force", targets="hand.flange.s")
    >>> stretch(75.0)  # 75/100 + 75/300
    (1.0, <Status.OK: 0>)
    """

    overdetermined: ClassVar[str] = ""

    @classmethod
    def _signature(cls) -> tuple[tuple[str, str, tuple[int, ...]], ...]:
        variables = [(name, i.role, i.shape) for name, i in cls._declared.items() if isinstance(i, Variable)]
        ports = [(name, i.cls.__name__, ()) for name, i in cls._declared.items() if isinstance(i, Port)]
        return (*variables, *ports)


def walk_declarations(cls: type[Model]) -> Iterator[tuple[str, Declaration]]:
    """Yield the declarations in the order of binding: parameters, free constants, discrete and continuous variables,
    ports, outer references, parts."""
    order = (Parameter, Free, Discrete, Variable, Port, Outer, Part)
    yield from sorted(cls._declared.items(), key=lambda kv: [isinstance(kv[1], kind) for kind in order].index(True))


def _merged(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    both = {k: _merged(old[k], v) for k, v in new.items() if isinstance(v, dict) and isinstance(old.get(k), dict)}
    return {**old, **new, **both}


def _without(modifiers: dict[str, Any], path: list[str]) -> tuple[dict[str, Any], Any]:
    """Return the modifiers without the one at this path, and its value; None if there is none."""
    name, *inner = path
    old = modifiers.get(name)
    if not inner:
        return {k: v for k, v in modifiers.items() if k != name}, old
    if not isinstance(old, dict):
        return modifiers, None
    rest, value = _without(old, inner)
    return {**modifiers, name: rest}, value


def _frozen(value: Any) -> Any:
    """Return a copy of a modifier whose arrays, also in lists and dictionaries, are read-only."""
    if isinstance(value, np.ndarray):
        value = value.copy()
        value.flags.writeable = False
    elif isinstance(value, dict):
        value = {k: _frozen(v) for k, v in value.items()}
    elif type(value) in (list, tuple):
        value = type(value)(_frozen(v) for v in value)
    return value


def check_modifiers(
    cls: type[Model],
    modifiers: dict[str, Any],
    where: SourceLocation,
    part: str = "",
    places: dict[str, SourceLocation] | None = None,
) -> None:
    """Raise ModelError for modifiers that a model of this class does not accept.

    part: full name of the part, "" for the whole model. places: file and line of single modifiers, `where` for all
    others.
    """
    what, default_place = f" (part '{part}')" if part else "", where
    for name, value in modifiers.items():
        where = (places or {}).get(name, default_place)
        if name not in cls._declared:
            hint = meant(name, cls._declared, f"it has {', '.join(sorted(cls._declared)) or 'none'}")
            raise ModelError(f"{cls.__name__}{what} has no declaration '{name}'; {hint}", where)
        item = cls._declared[name]
        if isinstance(item, (Port, Outer)):
            kind = "a port" if isinstance(item, Port) else "an outer reference"
            raise ModelError(f"'{name}' of {cls.__name__}{what} is {kind} and takes no modifier", where)
        if isinstance(item, Free):
            raise ModelError(
                f"'{name}' of {cls.__name__}{what} is chosen by the optimisation and takes no modifier; declare a "
                "parameter, or set another guess in a subclass",
                where,
            )
        if isinstance(item, Discrete):
            raise ModelError(
                f"'{name}' of {cls.__name__}{what} is a discrete variable and takes no modifier; pass its start value "
                f"to simulate(): start={{'{name}': ...}}",
                where,
            )
        if isinstance(item, Parameter) and not _symbolic(value):
            check_parameter(item, value, f"{part}.{name}" if part else name, where)
        elif isinstance(item, Variable) and (not isinstance(value, dict) or set(value) - set(ATTRIBUTES)):
            raise ModelError(
                f"'{name}' is a variable: its modifier must be a dictionary with keys from {', '.join(ATTRIBUTES)}; "
                f"found {value!r}",
                where,
            )


def _symbolic(value: Any) -> bool:
    """Return whether a modifier has no value before binding; also true for None."""
    if isinstance(value, (list, tuple)):
        return any(map(_symbolic, value))
    return value is None or isinstance(value, (Declaration, Each, Expr)) or callable(value)


_RESERVED = frozenset(
    [
        "equations",
        "initial_equations",
        "with_",
        "time",
        "causal",
        "mobility",
        "simulate",
        "objective",
        "where",
        "constraints",
    ]
)


def dependent(model: Model, *names: str) -> Model:
    """Return the model with inputs of its own class turned into variables, which equations around it determine.

    Raises ModelError if it declares no such input.
    """
    cls, declared = type(model), dict[str, Any]()
    for name in names:
        item = cls._declared.get(name)
        if not isinstance(item, Variable) or item.role != "input":
            raise ModelError(f"{cls.__name__} declares no input '{name}'; declare it in its own class", None)
        attributes = {k: v for k, v in item.attributes.items() if v is not None}
        declared[name] = variable(item.shape, unit=item.unit, **attributes)
    return type(cls.__name__, (cls,), declared)(**model._modifiers)
