"""EGM's messages for google.protobuf, from their field numbers: descriptors built at run time, no vendor file.

States and types are enumerations on the wire; here they are uint32, so that no value is put aside as unknown.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

Field = descriptor_pb2.FieldDescriptorProto
KINDS = {
    "uint32": Field.TYPE_UINT32,
    "bool": Field.TYPE_BOOL,
    "double": Field.TYPE_DOUBLE,
    "string": Field.TYPE_STRING,
    "fixed32": Field.TYPE_FIXED32,
    "bytes": Field.TYPE_BYTES,
}
NUMBERS = {f"n{n}": (n, "double") for n in range(1, 5)}
POSE = {"joints": (1, "Joints"), "cartesian": (2, "Pose"), "externalJoints": (3, "Joints"), "time": (4, "Clock")}
# message: {field: (number, kind)}; kinds with a star are repeated
SCHEMA: dict[str, dict[str, tuple[int, str]]] = {
    "Header": {"seqno": (1, "uint32"), "tm": (2, "uint32"), "mtype": (3, "uint32")},
    "Numbers": NUMBERS,
    "Joints": {"joints": (1, "double*")},
    "Clock": {"sec": (1, "uint32"), "usec": (2, "uint32")},
    "Pose": {"pos": (1, "Numbers"), "orient": (2, "Numbers"), "euler": (3, "Numbers")},
    "State": {"state": (1, "uint32")},
    "Signals": {"signals": (1, "double*")},
    "FeedBack": POSE,
    "Robot": {
        "header": (1, "Header"),
        "feedBack": (2, "FeedBack"),
        "planned": (3, "FeedBack"),
        "motorState": (4, "State"),
        "mciState": (5, "State"),
        "mciConvergenceMet": (6, "bool"),
        "testSignals": (7, "Signals"),
        "rapidExecState": (8, "State"),
        "measuredForce": (9, "Signals"),
        "utilizationRate": (10, "double"),
    },
    "Sensor": {"header": (1, "Header"), "planned": (2, "FeedBack"), "speedRef": (3, "FeedBack")},
    "Correction": {"pos": (1, "Numbers"), "age": (2, "uint32")},
    "SensorPathCorr": {"header": (1, "Header"), "pathCorr": (2, "Correction")},
    # what a later controller may add, in every wire type and inside every message
    "Unknown": {
        "a": (19, "uint32"),
        "b": (20, "double"),
        "c": (21, "string"),
        "d": (300, "fixed32"),
        "e": (99, "Pose"),
    },
}


# fields that the codecs do not read, so that what stands in them is not judged
NOT_READ = {"testSignals", "measuredForce", "utilizationRate", "time"}


def messages(*, packed: bool = False, without: Collection[str] = ()) -> dict[str, Any]:
    """Classes of the messages by name; repeated doubles with the option [packed = ...] of proto2."""
    package = f"egm{'_packed' if packed else ''}{'_less' if without else ''}"
    file = descriptor_pb2.FileDescriptorProto(name=f"{package}.proto", package=package, syntax="proto2")
    for name, fields in SCHEMA.items():
        message = file.message_type.add(name=name)
        for field, (number, kind) in fields.items():
            if field in without:
                continue
            base = kind.removesuffix("*")
            label = Field.LABEL_REPEATED if kind.endswith("*") else Field.LABEL_OPTIONAL
            made = message.field.add(name=field, number=number, label=label)
            if base in KINDS:
                made.type = KINDS[base]
            else:
                made.type, made.type_name = Field.TYPE_MESSAGE, f".{package}.{base}"
            if label == Field.LABEL_REPEATED:
                made.options.packed = packed
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{package}.{name}")) for name in SCHEMA}
