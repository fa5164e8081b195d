"""Models in Python files, named "package.module:Class" or "path/to/file.py:Class", and the translation of exceptions
into a status and a sentence."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import os
import sys
import sysconfig
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any, get_type_hints

from gtmodel.lang import Model, ModelError, UnitError
from gtmodel.modelica import reference as modelica
from gtmodel.results import SolveStatus, TrajectoryError, UnknownNameError

from .._near import meant
from .base import Context, InputError


def is_reference(text: str) -> bool:
    """Return True for a text that names an object in Python."""
    return ":" in text and not is_arm_file(text)


ARM_FILES = {".urdf": "URDF", ".sdf": "SDF", ".xml": "MJCF"}  # by ending


def is_arm_file(text: str) -> bool:
    """Return True for a file of an arm, "arm.urdf", "arm.sdf" or "arm.xml" (MJCF), and for "arm.urdf:tip", which names
    the last link of the chain."""
    return any(text.endswith(ending) or f"{ending}:" in text for ending in ARM_FILES)


def hint(text: str) -> str:
    """Return advice for a text that looks like Python but names no class; "" for any other text."""
    if text.endswith(".py") or ("." in text and not text.endswith((".toml", ".csv", ".json", *ARM_FILES))):
        return f"for a model in Python name its class too, as in '{text}:Robot'"
    return ""


def resolve(
    reference: str,
    context: Context,
    key: str,
    parameters: Mapping[str, Any] | None = None,
    base: type[Model] = Model,
    library: Sequence[str] = (),
    flattener: str = "gtmodel",
) -> Any:
    """Return the model that a reference names, configured with the parameters.

    A class is called with the parameters, and a model object gets them with `with_`. A function is called with them
    only if it is in the user's file or its annotation says that it returns a model. Modules are searched in the working
    directory, then in the problem's folder.

    Raises InputError if there is no such module, its import fails (with file and line), it has no such name, the name
    is not a `base`, or the model does not have a parameter.
    """
    if modelica.is_reference(reference):
        return _text(reference, context, key, parameters or {}, base, (library, flattener))
    place, _, name = reference.rpartition(":")
    if not place or not name:
        raise InputError(f"'{reference}' names no class; write 'package.module:Class' or 'file.py:Class'", key)
    module = _file(place, context, key) if place.endswith(".py") else _module(place, context, key)
    if getattr(module, "__file__", None):
        context.take(key, Path(str(module.__file__)))
    attribute = getattr(module, name, None)
    if attribute is None:
        public = [n for n, item in vars(module).items() if isinstance(item, type) and issubclass(item, base)]
        models = [n for n in public if vars(module)[n].__module__ == module.__name__]
        tail = meant(name, models, f"its models are {', '.join(models) or 'none'}")
        raise InputError(f"'{place}' has no '{name}'; {tail}", key)
    model = _configured(attribute, reference, key, dict(parameters or {}), base)
    context.models.append(model)
    return model


def _text(
    reference: str, context: Context, key: str, parameters: Mapping[str, Any], base: type[Model], how: tuple[Any, str]
) -> Any:
    """A class of a Modelica text; `how` has its libraries and flattener. Warnings go to the notes."""
    place, name = modelica.split(reference)
    path = context.file(place, key, key)
    library = [*modelica.libraries(), *(p if Path(p).is_absolute() else str(context.folder / p) for p in how[0])]
    whole = f"{path}:{name}" if name else str(path)
    try:
        translation = modelica.translated(whole, library=library, parameters=parameters, flattener=how[1])
        model = translation.model()
    except ModelError as error:
        raise InputError(sentence_of(error), "parameters" if parameters and error.where is None else key) from error
    if not isinstance(model, base):
        raise InputError(f"'{reference}' is a model; expected an optimization", key)
    context.notes += translation.warnings
    for n, file in enumerate(translation.libraries, 1):
        context.take(f"library{n}", file)
    if translation.flat_file is not None:
        context.take("flat", translation.flat_file)
    context.models.append(model)
    return model


def _configured(item: Any, reference: str, key: str, parameters: dict[str, Any], base: type[Model]) -> Any:
    if isinstance(item, type) and not issubclass(item, base):
        raise InputError(f"'{reference}' is not a subclass of {base.__name__}; its bases are {_bases(item)}", key)
    try:
        if isinstance(item, type) or _makes_models(item):
            model = item(**parameters)
        else:
            model = item.with_(**parameters) if isinstance(item, Model) else item
    except ModelError as error:
        raise InputError(sentence_of(error), "parameters" if parameters else key) from error
    if not isinstance(model, base):
        raise InputError(f"'{reference}' is {type(model).__name__}; expected a {base.__name__}", key)
    return model


def _makes_models(item: Any) -> bool:
    """True for a function that may be called: from the user's file, or annotated to return a model."""
    if not inspect.isfunction(item):
        return False
    if not item.__code__.co_filename.startswith(_INSTALLED):
        return True
    try:
        returned = get_type_hints(item).get("return")
    except Exception:  # the annotation names an unknown type
        return False
    return isinstance(returned, type) and issubclass(returned, Model)


def _bases(cls: type) -> str:
    return ", ".join(b.__name__ for b in cls.__mro__[1:])


def sentence_of(error: ModelError) -> str:
    """Return a model error's sentence, without the source line if that is in gtmodel and not in the user's file."""
    ours = error.where is not None and error.where.ours
    return str(error).removesuffix(f" ({error.where})") if ours else str(error)


def _module(name: str, context: Context, key: str) -> ModuleType:
    with _on_path(Path.cwd(), context.folder):
        _forget_namesake(name.partition(".")[0], key)
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name and (name == error.name or name.startswith(f"{error.name}.")):
                raise InputError(
                    f"there is no Python module '{name}' here or in {context.folder}, and none is installed", key
                ) from error
            raise InputError(fault(error, f"'{name}'"), key) from error
        except Exception as error:
            raise InputError(fault(error, f"'{name}'"), key) from error


def _forget_namesake(name: str, key: str) -> None:
    """Unload a user's module of that name from another folder; refuse the name of an installed package."""
    loaded = getattr(sys.modules.get(name), "__file__", None)
    spec = PathFinder.find_spec(name)
    if loaded is None or spec is None or spec.origin is None or Path(loaded) == Path(spec.origin):
        return
    if loaded.startswith(_INSTALLED):
        raise InputError(f"'{name}' is the name of an installed package; rename your file {spec.origin}", key)
    for module in [m for m in sys.modules if m == name or m.startswith(f"{name}.")]:
        del sys.modules[module]


def _file(place: str, context: Context, key: str) -> ModuleType:
    path = next((p for p in (context.folder / place, Path(place)) if p.is_file()), None)
    if path is None:
        raise InputError(f"there is no Python file '{place}' in {context.folder} or here", key)
    path = path.resolve()
    # files of the same name in different folders are different modules
    name = f"{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"'{place}' cannot be imported", key)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    with _on_path(path.parent, Path.cwd(), context.folder):
        try:
            spec.loader.exec_module(module)
        except Exception as error:
            del sys.modules[name]
            raise InputError(fault(error, f"'{place}'"), key) from error
    return module


@contextmanager
def _on_path(*folders: Path) -> Iterator[None]:
    before = list(sys.path)
    sys.path[:0] = [str(f.resolve()) for f in folders]
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path[:] = before


def fault(error: BaseException, what: str) -> str:
    """Return an error in a user's Python file as a sentence with file and line."""
    if isinstance(error, SyntaxError):
        return f"{what} is not Python: {error.msg} ({error.filename}:{error.lineno})"
    frames = traceback.extract_tb(error.__traceback__)
    users = [f for f in frames if "importlib" not in f.filename and not f.filename.startswith((_HERE, "<string>"))]
    place = f" ({users[-1].filename}:{users[-1].lineno})" if users else ""
    if isinstance(error, ModelError):
        return str(error)
    return f"{what} cannot be used: {type(error).__name__}: {error}{place}"


_HERE = str(Path(__file__).resolve().parents[1]) + os.sep
_INSTALLED = (sysconfig.get_path("stdlib"), sys.prefix, _HERE, "<frozen")


LONGEST = 300
_PACKAGE = str(Path(__file__).resolve().parents[1]) + os.sep
_NOBODYS = (_PACKAGE + "lang" + os.sep, _PACKAGE + "__init__.py", sysconfig.get_path("stdlib") + os.sep, "<")


def describe(error: BaseException, path: str = "") -> tuple[SolveStatus, str]:
    """Return the status and a sentence of at most `LONGEST` characters for an error; `path` is the problem file."""
    status, sentence = _described(error, shortened(path, LONGEST // 2))
    return status, shortened(sentence, LONGEST)


def shortened(text: str, most: int) -> str:
    """Shorten a text to at most `most` characters by cutting its middle: the end says what to do."""
    if len(text) <= most:
        return text
    end = most // 3
    head, tail = text[: most - end - 5], text[-end:]
    return f"{head.rpartition(' ')[0] or head} ... {tail.partition(' ')[2] or tail}"


def _described(error: BaseException, path: str) -> tuple[SolveStatus, str]:
    if isinstance(error, InputError):
        about_an_option = error.message.startswith("--") and not error.key
        return SolveStatus.BAD_INPUT, str(error if about_an_option else error.within(path))
    prefix = f"{path}: " if path else ""
    if isinstance(error, ModelError):
        # "arm.py:FiveBar: " plus "FiveBar: 1 equation ..." would name the model twice
        return SolveStatus.BAD_INPUT, prefix + sentence_of(error).removeprefix(f"{path.rpartition(':')[2]}: ")
    if isinstance(error, (UnitError, TrajectoryError, UnknownNameError)):
        return SolveStatus.BAD_INPUT, f"{prefix}{error}"
    if isinstance(error, OSError) and error.filename is not None:
        return SolveStatus.BAD_INPUT, f"{prefix}{error.filename}: {error.strerror}"
    if isinstance(error, KeyboardInterrupt):
        return SolveStatus.INTERRUPTED, f"{prefix}stopped before there was a result"
    if _in_users_code(error):
        return SolveStatus.BAD_INPUT, prefix + fault(error, "the model")
    text = shortened(" ".join(str(error).split()), LONGEST // 2)
    return SolveStatus.FAILED, (
        f"{prefix}internal error: {type(error).__name__}: {text}; please report it, with the traceback "
        "that gtmodel --debug shows"
    )


def _in_users_code(error: BaseException) -> bool:
    """True if the last frame of the traceback, apart from gtmodel.lang and libraries, is not in gtmodel."""
    owner = ""
    for frame in traceback.extract_tb(error.__traceback__):
        name = frame.filename
        if not name.startswith(_NOBODYS) and "site-packages" not in name:
            owner = name
    return bool(owner) and not owner.startswith(_PACKAGE)
