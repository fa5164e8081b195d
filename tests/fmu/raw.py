"""A unit called by ctypes as the standard's headers say: every status is seen, nothing is raised."""

from __future__ import annotations

import ctypes as c
import io
import zipfile
from pathlib import Path

import numpy as np

OK, WARNING, DISCARD, ERROR = range(4)
LOG3 = c.CFUNCTYPE(None, c.c_void_p, c.c_int, c.c_char_p, c.c_char_p)
LOG2 = c.CFUNCTYPE(None, c.c_void_p, c.c_char_p, c.c_int, c.c_char_p, c.c_char_p)
ALLOCATE = c.CFUNCTYPE(c.c_void_p, c.c_size_t, c.c_size_t)
RELEASE = c.CFUNCTYPE(None, c.c_void_p)


class Callbacks(c.Structure):
    _fields_ = [("logger", LOG2), ("allocate", c.c_void_p), ("free", c.c_void_p), ("finished", c.c_void_p),
                ("environment", c.c_void_p)]  # fmt: skip


def unpacked(unit, place: Path) -> Path:
    """The library of the archive on disk."""
    with zipfile.ZipFile(io.BytesIO(unit.data)) as z:
        z.extractall(place)
    return next((place / "binaries").rglob("*.so"))


def _doubles(values):
    a = np.ascontiguousarray(values, dtype=float)
    return a, a.ctypes.data_as(c.c_void_p)


def _references(values):
    a = np.ascontiguousarray(values, dtype=np.uint32)
    return a, a.ctypes.data_as(c.c_void_p)


class Raw:
    """One instance; `co` for co-simulation. After `begin` it is ready to run."""

    def __init__(self, unit, library: Path, co: bool = True, token: str | None = None, name: bytes = b"raw") -> None:
        self.unit, self.table, self.three, self.co = unit, unit.table, unit.version == 3, co
        self.dll = c.CDLL(str(library))
        self.said: list[tuple[int, str, str]] = []
        self.prefix = f"fmi{unit.version}"
        token = (unit.token if token is None else token).encode()
        if self.three:
            self.log = LOG3(
                lambda _e, status, category, text: self.said.append((status, category.decode(), text.decode()))
            )
            make = self.f("InstantiateCoSimulation" if co else "InstantiateModelExchange", c.c_void_p)
            more = [c.c_bool(False), c.c_bool(False), None, c.c_size_t(0)] if co else []
            last = [None] if co else []
            self.i = make(name, token, b"", c.c_bool(False), c.c_bool(True), *more, None, self.log, *last)
        else:
            self.log = LOG2(lambda _e, _n, s, category, text: self.said.append((s, category.decode(), text.decode())))
            self.callbacks = Callbacks(self.log, None, None, None, None)
            make = self.f("Instantiate", c.c_void_p)
            self.i = make(name, int(co), token, b"", c.byref(self.callbacks), 0, 1)
        self.i = c.c_void_p(self.i) if self.i else None
        self.names = {v.name: v.reference for v in self.table.variables}

    def f(self, name: str, result=c.c_int):
        function = self.dll[f"{self.prefix}{name}"]
        function.restype = result
        return function

    def do(self, name: str, *arguments) -> int:
        return self.f(name)(self.i, *arguments)

    def begin(self, values=None, time: float = 0.0, step=True) -> int:
        """Into initialisation and out of it."""
        if self.three:
            no, zero = c.c_bool(False), c.c_double(0)
            status = self.do("EnterInitializationMode", no, zero, c.c_double(time), no, zero)
        else:
            self.do("SetupExperiment", 0, c.c_double(0), c.c_double(time), 0, c.c_double(0))
            status = self.do("EnterInitializationMode")
        for name, value in (values or {}).items():
            status = max(status, self.set([self.names[name]], [value]))
        status = max(status, self.do("ExitInitializationMode"))
        if not self.co and step:
            status = max(status, self.update()[0], self.do("EnterContinuousTimeMode"))
        return status

    def update(self):
        if self.three:
            flags = [c.c_bool() for _ in range(5)]
            next_time = c.c_double()
            status = self.do("UpdateDiscreteStates", *map(c.byref, flags), c.byref(next_time))
            return status, flags[4].value, next_time.value

        class Info(c.Structure):
            _fields_ = [(f"b{k}", c.c_int) for k in range(5)] + [("next", c.c_double)]

        info = Info()
        status = self.do("NewDiscreteStates", c.byref(info))
        return status, bool(info.b4), info.next

    def completed(self) -> int:
        flags = [c.c_bool(), c.c_bool()] if self.three else [c.c_int(), c.c_int()]
        return self.do("CompletedIntegratorStep", c.c_bool(True) if self.three else 1, *map(c.byref, flags))

    def set(self, references, values) -> int:
        r, rp = _references(references)
        v, vp = _doubles(values)
        more = [c.c_size_t(len(v))] if self.three else []
        return self.do("SetFloat64" if self.three else "SetReal", rp, c.c_size_t(len(r)), vp, *more)

    def get(self, references, held: float = -77.0):
        """Status, and values, `held` where none were written."""
        r, rp = _references(references)
        v, vp = _doubles(np.full(len(r), held))
        more = [c.c_size_t(len(v))] if self.three else []
        status = self.do("GetFloat64" if self.three else "GetReal", rp, c.c_size_t(len(r)), vp, *more)
        return status, v

    def set_integers(self, references, values) -> int:
        r, rp = _references(references)
        v = np.ascontiguousarray(values, dtype=np.int32)
        more = [c.c_size_t(len(v))] if self.three else []
        vp = v.ctypes.data_as(c.c_void_p)
        return self.do("SetInt32" if self.three else "SetInteger", rp, c.c_size_t(len(r)), vp, *more)

    def get_integers(self, references):
        r, rp = _references(references)
        v = np.full(len(r), -77, np.int32)
        more = [c.c_size_t(len(v))] if self.three else []
        vp = v.ctypes.data_as(c.c_void_p)
        status = self.do("GetInt32" if self.three else "GetInteger", rp, c.c_size_t(len(r)), vp, *more)
        return status, v

    def set_time(self, t: float) -> int:
        return self.do("SetTime", c.c_double(t))

    def set_states(self, x) -> int:
        v, vp = _doubles(x)
        return self.do("SetContinuousStates", vp, c.c_size_t(len(v)))

    def states(self):
        v, vp = _doubles(np.full(len(self.table.states), -77.0))
        return self.do("GetContinuousStates", vp, c.c_size_t(len(v))), v

    def derivatives(self):
        v, vp = _doubles(np.full(len(self.table.states), -77.0))
        name = "GetContinuousStateDerivatives" if self.three else "GetDerivatives"
        return self.do(name, vp, c.c_size_t(len(v))), v

    def step(self, t: float, h: float):
        """Status and lastSuccessfulTime."""
        if self.three:
            flags = [c.c_bool() for _ in range(3)]
            last = c.c_double(-77.0)
            arguments = [c.c_double(t), c.c_double(h), c.c_bool(True), *map(c.byref, flags), c.byref(last)]
            return self.do("DoStep", *arguments), last.value
        status = self.do("DoStep", c.c_double(t), c.c_double(h), 1)
        last = c.c_double(-77.0)
        self.do("GetRealStatus", 2, c.byref(last))
        return status, last.value

    def directional(self, unknowns, knowns, seed, adjoint=False):
        u, up = _references(unknowns)
        k, kp = _references(knowns)
        s, sp = _doubles(seed)
        r, rp = _doubles(np.full(len(k) if adjoint else len(u), -77.0))
        if self.three:
            name = "GetAdjointDerivative" if adjoint else "GetDirectionalDerivative"
            status = self.do(name, up, c.c_size_t(len(u)), kp, c.c_size_t(len(k)), sp, c.c_size_t(len(s)), rp,
                             c.c_size_t(len(r)))  # fmt: skip
        else:
            status = self.do("GetDirectionalDerivative", up, c.c_size_t(len(u)), kp, c.c_size_t(len(k)), sp, rp)
        return status, r

    def save(self):
        state = c.c_void_p()
        assert self.do("GetFMUState" if self.three else "GetFMUstate", c.byref(state)) == OK
        return state

    def restore(self, state) -> int:
        return self.do("SetFMUState" if self.three else "SetFMUstate", state)

    def forget(self, state) -> int:
        return self.do("FreeFMUState" if self.three else "FreeFMUstate", c.byref(state))

    def serialized(self, state) -> bytes:
        name = "FMUState" if self.three else "FMUstate"
        size = c.c_size_t()
        assert self.do(f"Serialized{name}Size", state, c.byref(size)) == OK
        place = c.create_string_buffer(size.value)
        assert self.do(f"Serialize{name}", state, place, size) == OK
        return place.raw

    def deserialized(self, data: bytes):
        """Status and state."""
        state = c.c_void_p()
        name = "DeserializeFMUState" if self.three else "DeSerializeFMUstate"
        return self.do(name, data, c.c_size_t(len(data)), c.byref(state)), state

    def free(self) -> None:
        self.f("FreeInstance", None)(self.i)
