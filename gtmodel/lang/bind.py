"""Binding: turns a configured model into a tree of components whose attributes are expressions."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from .declarations import Declaration, Discrete, Each, Free, Outer, Parameter, Part, Port, Variable
from .expression import Expr, gathered, operand, row_by_row
from .model import Connector, Model, check_modifiers, walk_declarations
from .scope import Scope
from .source import ModelError, SourceLocation
from .units import SECOND
from .values import check_bound, check_parameter, fits, shape_text


@dataclass
class VariableRecord:
    """A declared variable after binding: name, indices of its derivative chains, attributes (SX or None)."""

    name: str
    item: Variable
    component: str
    indices: list[int]
    attributes: dict[str, Any]


@dataclass
class ParameterRecord:
    """A declared parameter after binding: symbols with numeric values, or an expression of other parameters."""

    name: str
    item: Parameter | Free | Discrete
    component: str
    expression: ca.SX
    indices: list[int]
    values: np.ndarray | None
    shape: tuple[int, ...]
    where: SourceLocation


@dataclass
class Tree:
    """All records that binding created, in declaration order."""

    scope: Scope
    root: Model
    components: list[Model] = field(default_factory=list)
    variables: list[VariableRecord] = field(default_factory=list)
    parameters: list[ParameterRecord] = field(default_factory=list)
    ports: list[Connector] = field(default_factory=list)
    inner_defaults: dict[type, Model] = field(default_factory=dict)


def bind(model: Model) -> Tree:
    """Bind a configured model: create all symbols and resolve modifiers, parts, ports and outer references."""
    if not isinstance(model, Model):
        hint = f"; write {model.__name__}()" if isinstance(model, type) else ""
        raise ModelError(f"expected a configured model; found {model!r}{hint}")
    scope = Scope()
    tree = Tree(scope=scope, root=model)
    places = {name: model.__dict__["where"] for name in model.__dict__["_modifiers"]}
    tree.root = _bind(model, {}, "", None, tree, places)
    check_bound(tree)
    return tree


def empty_tree(root: Model) -> Tree:
    """Return a tree with only a bound root, for a Builder to extend."""
    tree = Tree(scope=Scope(), root=root)
    tree.root = _bind(root, {}, "", None, tree)
    return tree


def bind_variable(item: Variable, tree: Tree) -> Expr:
    """Bind one more variable of the root."""
    return _variable(item, {}, item.name, "", tree.root, tree)


def bind_parameter(item: Parameter, tree: Tree) -> Expr:
    """Bind one more parameter of the root."""
    return _parameter(item, None, item.name, "", False, tree, item.where)


def bind_discrete(item: Discrete, tree: Tree) -> Expr:
    """Bind one more discrete variable of the root."""
    return _discrete(item, item.name, "", tree)


def bind_part(item: Part, config: Model, tree: Tree) -> Model:
    """Bind one more component of the root."""
    part = _bind(config, {}, item.name, tree.root, tree)
    part.__dict__["_where"] = item.where
    return part


def join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _bind(
    config: Model,
    extra: dict[str, Any],
    path: str,
    parent: Model | None,
    tree: Tree,
    places: dict[str, SourceLocation] | None = None,
) -> Model:
    """`places`: file and line of each modifier whose line is known."""
    cls, places = type(config), places or {}
    for item in (item for base in cls.__mro__ for item in vars(base).values()):
        if isinstance(item, Declaration) and item.name == Declaration.name:
            raise ModelError(
                f"a declaration was added to {cls.__name__} after its class body; write it in the class body",
                item.where,
            )
    bound = object.__new__(cls)
    values: dict[str, Any] = {}
    bound.__dict__.update(_path=path, _parent=parent, _values=values, _scope=tree.scope)
    bound.__dict__["_time"] = Expr(tree.scope.time, (), SECOND, tree.scope)
    modifiers = {**config.__dict__["_modifiers"], **extra}
    if parent is not None:
        modifiers = _resolve(modifiers, parent)
    if not isinstance(bound, Connector):
        tree.components.append(bound)

    def member(name: str, item: Declaration) -> None:
        modifier = modifiers.get(name)
        full = join(path, name)
        if isinstance(item, Parameter):
            values[name] = _parameter(item, modifier, full, path, name in modifiers, tree, places.get(name, item.where))
        elif isinstance(item, Free):
            values[name] = _free(item, full, path, tree)
        elif isinstance(item, Discrete):
            values[name] = _discrete(item, full, path, tree)
        elif isinstance(item, Variable):
            values[name] = _variable(item, modifier or {}, full, path, bound, tree)
        elif isinstance(item, Port):
            values[name] = _port(item, full, bound, tree)
        elif isinstance(item, Outer):
            values[name] = _outer(item, bound, tree)
        elif isinstance(item, Part):
            values[name] = _part(item, modifier, full, bound, tree, places.get(name))

    # an outer reference in a nested component may bind a part out of order
    pending = {name: partial(member, name, item) for name, item in walk_declarations(cls)}
    bound.__dict__.update(_pending=pending, _classes={k: _class_of(modifiers.get(k)) for k in modifiers})
    while pending:
        pending.pop(next(iter(pending)))()
    return bound


def _class_of(modifier: Any) -> type | None:
    """Return the class with which a modifier replaces a part's class; None if it does not replace it."""
    if isinstance(modifier, Redeclared):
        return modifier.cls
    if isinstance(modifier, Model):
        return type(modifier)
    return modifier if isinstance(modifier, type) else None


def element_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the scalar names of a vector or matrix: x[0], x[1], or A[0,0], A[0,1], ... (row by row)."""
    if not shape:
        return [name]
    return [f"{name}[{','.join(map(str, index))}]" for index in product(*map(range, shape))]


def _assemble(symbols: list[ca.SX], shape: tuple[int, ...]) -> ca.SX:
    """Return scalars, listed row by row, as a column vector or matrix."""
    if not shape:
        return symbols[0]
    if len(shape) == 1:
        return ca.vertcat(*symbols)
    return ca.reshape(ca.vertcat(*symbols), shape[1], shape[0]).T


def _parameter(
    item: Parameter, modifier: Any, full: str, path: str, is_set: bool, tree: Tree, where: SourceLocation
) -> Expr:
    modifier = gathered(modifier)
    if isinstance(modifier, Expr):
        if not fits(modifier.shape, item.shape):
            shape = shape_text(item.shape)
            raise ModelError(
                f"parameter '{full}' has shape {shape}; found an expression of shape {modifier.shape}", where
            )
        if None not in (modifier.dimension, item.dimension) and modifier.dimension != item.dimension:
            raise ModelError(
                f"units differ: parameter '{full}' is in {item.unit}, its expression is in {modifier.dimension}",
                where,
            )
        record = ParameterRecord(full, item, path, row_by_row(modifier.sx), [], None, modifier.shape, where)
        tree.parameters.append(record)
        return modifier
    value = modifier if is_set else item.default
    array = None if value is None else check_parameter(item, value, full, where)
    if array is None and -1 in item.shape:
        raise ModelError(f"parameter '{full}' of shape {shape_text(item.shape)} has no value; set it", where)
    shape = item.shape if array is None else array.shape
    values = None if array is None else array.reshape(-1)
    names = element_names(full, shape)
    first = len(tree.scope.parameters)
    symbols = [tree.scope.new_parameter(n) for n in names]
    indices = list(range(first, first + len(names)))
    sx = _assemble(symbols, shape)
    tree.parameters.append(ParameterRecord(full, item, path, ca.vertcat(*symbols), indices, values, shape, where))
    return Expr(sx, shape, item.dimension, tree.scope)


def _free(item: Free, full: str, path: str, tree: Tree) -> Expr:
    names = element_names(full, item.shape)
    first = len(tree.scope.parameters)
    symbols = [tree.scope.new_parameter(n) for n in names]
    values = np.asarray(item.guess, float).reshape(-1)
    indices = list(range(first, first + len(names)))
    record = ParameterRecord(full, item, path, ca.vertcat(*symbols), indices, values, item.shape, item.where)
    tree.parameters.append(record)
    dimension = item.dimension if item.unit is not None else (SECOND if full.endswith("_time") else None)
    return Expr(_assemble(symbols, item.shape), item.shape, dimension, tree.scope)


def _discrete(item: Discrete, full: str, path: str, tree: Tree) -> Expr:
    """Bind a discrete variable like a parameter: its derivative is zero, and events assign new values."""
    names = element_names(full, item.shape)
    first = len(tree.scope.parameters)
    symbols = [tree.scope.new_parameter(n) for n in names]
    values = np.broadcast_to(item.start, item.shape).reshape(-1).copy()
    indices = list(range(first, first + len(names)))
    record = ParameterRecord(full, item, path, ca.vertcat(*symbols), indices, values, item.shape, item.where)
    tree.parameters.append(record)
    return Expr(_assemble(symbols, item.shape), item.shape, item.dimension, tree.scope)


def _variable(item: Variable, modifier: dict[str, Any], full: str, path: str, bound: Model, tree: Tree) -> Expr:
    scope = tree.scope
    names = element_names(full, item.shape)
    first = len(scope.chains)
    symbols = [scope.new_chain(n) for n in names]
    attributes: dict[str, Any] = {}
    for key, value in {**item.attributes, **modifier}.items():
        if key in ("fixed", "prefer") or value is None:
            attributes[key] = value
            continue
        if isinstance(value, Declaration):
            value = getattr(bound, value.name)
        elif callable(value):
            value = value(bound)
        if isinstance(value, str):
            raise ModelError(f"attribute {key} of '{full}' takes numbers; found {value!r}", item.where)
        sx, shape = _bound(key, value) or operand(value, scope)
        if shape != item.shape and shape != ():
            raise ModelError(f"attribute {key} of '{full}' has shape {shape}; expected {item.shape}", item.where)
        column = ca.repmat(sx, len(names), 1) if shape == () and len(names) > 1 else row_by_row(sx)
        attributes[key] = column
    indices = list(range(first, first + len(names)))
    tree.variables.append(VariableRecord(full, item, path, indices, attributes))
    return Expr(_assemble(symbols, item.shape), item.shape, item.dimension, scope)


def _bound(key: str, value: Any) -> tuple[ca.SX, tuple[int, ...]] | None:
    """Return bounds of which some are infinite, because an entry has none; None for any other attribute."""
    if key not in ("min", "max") or isinstance(value, Expr):
        return None
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        return None
    none = array == (-np.inf if key == "min" else np.inf)
    if array.ndim > 2 or not np.any(none) or not np.all(none | np.isfinite(array)):
        return None
    return ca.SX(ca.DM(array)), array.shape


def _port(item: Port, full: str, owner: Model, tree: Tree) -> Any:
    def bind_one(name: str) -> Model:
        connector = _bind(item.cls(), {}, name, owner, tree)
        assert isinstance(connector, Connector)
        tree.ports.append(connector)
        return connector

    if item.count is None:
        return bind_one(full)
    return [bind_one(f"{full}[{i}]") for i in range(item.count)]


def _outer(item: Outer, bound: Model, tree: Tree) -> Model:
    parent: Model | None = bound.__dict__["_parent"]
    while parent is not None:
        for value in parent.__dict__["_values"].values():
            if isinstance(value, item.cls):
                return value
        for name, part in type(parent)._declared.items():
            if not isinstance(part, Part) or part.count is not None or name not in parent.__dict__["_pending"]:
                continue
            if issubclass(parent.__dict__["_classes"].get(name) or part.cls, item.cls):
                parent.__dict__["_pending"].pop(name)()
                return parent.__dict__["_values"][name]
        parent = parent.__dict__["_parent"]
    if item.cls not in tree.inner_defaults:
        path = item.cls.__name__.lower()
        tree.inner_defaults[item.cls] = _bind(item.cls(), {}, path, None, tree)
    return tree.inner_defaults[item.cls]


def _resolve(value: Any, parent: Model) -> Any:
    """Evaluate a modifier in the component that wrote it: replace declarations by their expressions."""
    if isinstance(value, Declaration):
        if value.name not in type(parent)._declared:
            raise ModelError(f"a modifier refers to '{value.name}', which {type(parent).__name__} does not declare")
        return getattr(parent, value.name)
    if isinstance(value, Each):
        return Each(_resolve(value.value, parent))
    if isinstance(value, dict):
        return {k: _resolve(v, parent) for k, v in value.items()}
    if type(value) in (list, tuple):
        return type(value)(_resolve(v, parent) for v in value)
    if isinstance(value, Model):
        given = value.__dict__.get("_modifiers")
        return value if given is None else Redeclared(type(value), _resolve(given, parent))
    if callable(value) and not isinstance(value, type):
        return _resolve(value(parent), parent)
    return value


def _part(item: Part, modifier: Any, full: str, parent: Model, tree: Tree, place: SourceLocation | None) -> Any:
    """`place`: file and line of the enclosing configuration, if it modifies this part."""

    def bind_one(inner: dict[str, Any], override: Any, full: str) -> Model:
        merged = _merge(Redeclared(item.cls, inner), override)
        outer = override.modifiers if isinstance(override, Redeclared) else override
        places = dict.fromkeys(inner, item.where)
        if place is not None and isinstance(outer, dict):
            places |= dict.fromkeys(outer, place)
        cls, mods = _split(merged, full, item.where, places)
        bound = _bind(cls(), mods, full, parent, tree, places)
        bound.__dict__["_where"] = item.where
        return bound

    if item.count is None:
        return bind_one({k: _resolve(v, parent) for k, v in item.modifiers.items()}, modifier, full)
    count = len(modifier) if isinstance(modifier, (list, tuple)) else item.count
    result = []
    for i in range(count):
        mods = {
            k: _element(_resolve(v, parent), i, count, f"{full}.{k}", item.where) for k, v in item.modifiers.items()
        }
        result.append(bind_one(mods, modifier[i] if isinstance(modifier, (list, tuple)) else modifier, f"{full}[{i}]"))
    return result


@dataclass(frozen=True)
class Redeclared:
    """A part's class and modifiers after merging the inner and outer declarations."""

    cls: type[Model]
    modifiers: dict[str, Any]


def _redeclared(value: Any) -> Any:
    """Return a class or a model as a Redeclared; any other value unchanged."""
    if isinstance(value, Model):
        return Redeclared(type(value), value.__dict__["_modifiers"])
    return Redeclared(value, {}) if isinstance(value, type) else value


def _merge(old: Any, new: Any) -> Any:
    """Merge the modifiers of an inner and an outer declaration; the outer one wins."""
    if new is None:
        return old
    new, old = _redeclared(new), _redeclared(old)
    if isinstance(new, Redeclared):
        inner = old if isinstance(old, dict) else old.modifiers if isinstance(old, Redeclared) else {}
        return Redeclared(new.cls, _merge(inner, new.modifiers))
    if isinstance(new, dict) and isinstance(old, dict):
        return {**old, **{k: _merge(old.get(k), v) for k, v in new.items()}}
    if isinstance(new, dict) and isinstance(old, Redeclared):
        return Redeclared(old.cls, _merge(old.modifiers, new))
    return new


def _split(
    merged: Any, full: str, where: SourceLocation, places: dict[str, SourceLocation]
) -> tuple[type[Model], dict[str, Any]]:
    if isinstance(merged, Redeclared) and issubclass(merged.cls, Model):
        check_modifiers(merged.cls, merged.modifiers, where, full, places)
        return merged.cls, merged.modifiers
    raise ModelError(f"part '{full}' takes a Model class, a model or a dictionary; found {merged!r}", where)


def _element(value: Any, i: int, count: int, name: str, where: SourceLocation) -> Any:
    if isinstance(value, Each):
        return value.value
    if isinstance(value, (type, Model, dict, Redeclared)):
        return value
    if isinstance(value, Expr) and not value.shape:  # a scalar of the enclosing model goes to all elements
        return value
    try:
        n = len(value)
    except TypeError:  # a number or a zero-dimensional array
        n = None
    if n != count:
        raise ModelError(
            f"modifier '{name}' of an array of {count} parts needs {count} rows; found "
            f"{'a single value' if n is None else n}; use gt.each(...) to give all parts the same value",
            where,
        )
    return value[i]
