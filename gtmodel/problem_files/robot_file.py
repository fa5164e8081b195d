"""Robots in TOML files: by family, the keys of the published tables in gtmodel/robots/data."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import Field, PositiveFloat

from gtmodel.geometry.quaternions import quaternion_of, zyz_quaternion
from gtmodel.lang import ModelError
from gtmodel.robots import f1_geometry, links
from gtmodel.robots.plausible_lengths import implausible_arm, implausible_length
from gtmodel.robots.serial.structure import moments

from .._near import near
from .base import FileSection, InputError
from .load import shown, validate
from .python_models import is_arm_file, is_reference, sentence_of

NotNegativeFloat = Annotated[float, Field(ge=0)]
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Points = Annotated[list[Vector], Field(min_length=6, max_length=6)]
Positive = Annotated[list[PositiveFloat], Field(min_length=3, max_length=3)]
NotNegative = Annotated[list[NotNegativeFloat], Field(min_length=3, max_length=3)]
Lengths = Annotated[list[PositiveFloat], Field(min_length=6, max_length=6)]
LinkMasses = Annotated[list[NotNegativeFloat], Field(min_length=6, max_length=6)]

# largest deviation of a cluster's links from parallel [m]; more is a wrong sign or row, not a calibration
MISFIT = 0.05
PYTHON_KEYS = {"title", "source", "note", "robot", "parameters"}  # for another robot with parameters


class _Robot(FileSection):
    """Keys of all families; the default masses and friction are those of the catalogue."""

    title: str = Field(default="", description="name of the robot")
    prototype: str = Field(default="", description="name of the machine")
    source: str = Field(default="", description="origin of the numbers")
    note: str = Field(default="", description="frame and remarks")
    m_p_kg: PositiveFloat | None = Field(default=None, description="plate mass, joints and tool included")
    m_c_kg: Positive | None = Field(default=None, description="cart masses, joints included")
    coulomb_N: NotNegative | None = Field(default=None, description="Coulomb friction of each cart")
    viscous_kg_s: NotNegative | None = Field(default=None, description="viscous friction of each cart")

    def modifiers(self) -> dict[str, Any]:
        """Return the parameters of the family's model. Raises InputError."""
        if wrong := implausible_length(self.model_dump()):
            raise InputError(wrong[1], wrong[0])
        chosen = {
            "m_p": self.m_p_kg,
            "m_c": self.m_c_kg,
            "coulomb": self.coulomb_N,
            "viscous": self.viscous_kg_s,
            **self.more(),
        }
        return self.geometry() | {name: value for name, value in chosen.items() if value is not None}

    @abstractmethod
    def geometry(self) -> dict[str, Any]:
        """Return all geometric parameters, including the home pose."""

    def more(self) -> dict[str, Any]:
        """Return the masses that only this family has; None for those left out."""
        return {}


class RobotFile(_Robot):
    """A three-link Gantry-Tau; one entry or row per arm. `inertia` of the problem sets masses and friction left out."""

    family: Literal["three_link"] = Field(default="three_link", description="kinematic structure")
    A_m: Matrix = Field(description="cart joints at q = 0")
    v: Matrix = Field(description="guideway directions, not normalised: the length scales q")
    L_m: Positive = Field(description="link lengths")
    home_m: Vector | None = Field(default=None, description="a reachable position of the tool centre point")
    m_a_kg: NotNegative | None = Field(default=None, description="masses of the link clusters")

    def geometry(self) -> dict[str, Any]:
        A, v, L = np.array(self.A_m), np.array(self.v), np.array(self.L_m)
        home = A.mean(axis=0) + 0.7 * L.mean() * v.mean(axis=0) if self.home_m is None else self.home_m
        return {"A": A, "v": v, "L": L, "home": home}

    def more(self) -> dict[str, Any]:
        return {"m_a": self.m_a_kg}


class _SixLinks(_Robot):
    links: list[str] | None = Field(default=None, description="names of the links, 1, 2a, 2b, 3a, 3b, 3c in this order")
    m_a_kg: LinkMasses | None = Field(default=None, description="link masses")
    c_p_m: Vector | None = Field(default=None, description="plate's centre of mass, plate coordinates")
    I_p_kg_m2: Matrix | None = Field(
        default=None,
        description="plate's inertia tensor about its centre of mass, plate axes",
        json_schema_extra={"unit": "kg.m2"},
    )

    def more(self) -> dict[str, Any]:
        return {"m_a": self.m_a_kg, "c_p": self.c_p_m, "I_p": self.I_p_kg_m2}

    def modifiers(self) -> dict[str, Any]:
        if self.links is not None and tuple(self.links) != links.LINKS:
            raise InputError(f"must be {', '.join(links.LINKS)} in this order; found {', '.join(self.links)}", "links")
        return super().modifiers()


class SixLinkFile(_SixLinks):
    """A six-link Gantry-Tau; one entry or row per link, 1, 2a, 2b, 3a, 3b, 3c."""

    family: Literal["six_link"] = Field(description="kinematic structure")
    A_m: Points = Field(description="cart joints at q = 0")
    v: Points = Field(description="motion of the cart joints per q, not normalised: the length scales q")
    L_m: Lengths = Field(description="link lengths")
    B_m: Points = Field(description="plate joints from the tool centre point, plate coordinates")
    home_m: Vector | None = Field(default=None, description="a reachable position of the tool centre point")
    home_zyz_deg: Vector | None = Field(
        default=None, description="z-y-z angles of the plate at home; if left out, the links of a cluster are parallel"
    )

    def geometry(self) -> dict[str, Any]:
        A, v, L, B = (np.array(x) for x in (self.A_m, self.v, self.L_m, self.B_m))
        home = A.mean(axis=0) + 0.85 * L.mean() * v.mean(axis=0) if self.home_m is None else self.home_m
        if self.home_zyz_deg is not None:
            e = zyz_quaternion(*np.radians(self.home_zyz_deg))
        else:
            e, misfit = links.attitude(A, B)
            _refuse(misfit, "B_m", "; if the links of a cluster are not parallel, give home_zyz_deg")
        return {"A": A, "v": v, "L": L, "B": B, "home": home, "home_e": e}


class F1File(_SixLinks):
    """An F1, with rotary axes on carts 2 and 3, in mm as published; quaternions scalar first, not normalised."""

    family: Literal["f1"] = Field(description="kinematic structure")
    A0_mm: Matrix = Field(description="reference points of the carts at q = 0")
    v: Vector | Matrix = Field(description="guideway direction of all carts or one row each, not normalised")
    L_mm: Lengths = Field(description="link lengths")
    A_bj_mm: Points = Field(description="cart joints in the frames of their joint plates")
    B0_mm: Points = Field(description="plate joints from the tool centre point, plate coordinates")
    u1_2: Quaternion = Field(description="quaternion of S_2, scalar first, not normalised")
    u1_3: Quaternion = Field(description="quaternion of 1S_3, scalar first, not normalised")
    u2_3: Quaternion = Field(description="quaternion of 2S_3 in 1S_3, scalar first, not normalised")
    r3_mm: Vector = Field(description="origin of 2S_3 in 1S_3")
    home_mm: Vector | None = Field(default=None, description="a reachable position with the rotary axes near 0")
    J_kg_m2: Positive | None = Field(
        default=None, description="inertias of the rotary axes", json_schema_extra={"unit": "kg.m2"}
    )

    def geometry(self) -> dict[str, Any]:
        table = f1_geometry.of_table(self.model_dump())
        R, misfit = f1_geometry.home_rotation(table)
        _refuse(misfit, "u1_2", ", or of u1_3, u2_3, A_bj_mm and B0_mm")
        home = f1_geometry.home(table) if self.home_mm is None else np.array(self.home_mm) / 1e3
        return {**table, "home": home, "home_e": quaternion_of(R, positive="largest")}

    def more(self) -> dict[str, Any]:
        return {**super().more(), "J": self.J_kg_m2}


class SerialFile(FileSection):
    """A serial arm by Denavit-Hartenberg parameters; one entry or row per joint."""

    family: Literal["serial"] = Field(description="kinematic structure")
    title: str = Field(default="", description="name of the robot")
    source: str = Field(default="", description="origin of the numbers")
    note: str = Field(default="", description="frame and remarks")
    convention: Literal["standard", "modified"] = Field(default="standard", description="modified: Craig's convention")
    joints: str | list[str] = Field(
        default="r", description="r (revolute) or p (prismatic) for each joint, as rrp, or one letter for all"
    )
    names: list[str] | None = Field(default=None, description="names of the joints")
    a_m: list[float] = Field(description="link lengths")
    alpha_deg: list[float] = Field(description="link twists")
    d_m: list[float] = Field(description="offsets along the axes")
    theta_deg: list[float] | None = Field(default=None, description="joint angles at q = 0")
    beta_deg: list[float] | None = Field(default=None, description="Hayati's angles, for parallel consecutive axes")
    limits_deg: list[Pair] | None = Field(default=None, description="lower and upper limits of revolute joints")
    limits: list[Pair] | None = Field(default=None, description="lower and upper limits, in rad or, if prismatic, in m")
    start_deg: list[float] | list[list[float]] | None = Field(default=None, description="home pose, further starts")
    start: list[float] | list[list[float]] | None = Field(default=None, description="the same in rad or m")
    base_m: Vector | None = Field(default=None, description="position of the base in the world frame")
    base_rpy_deg: Vector | None = Field(default=None, description="roll, pitch and yaw of the base")
    tool_m: Vector | None = Field(default=None, description="tool centre point in the last frame")
    tool_rpy_deg: Vector | None = Field(default=None, description="roll, pitch and yaw of the tool in the last frame")
    m_kg: list[float] | None = Field(default=None, description="masses of the links")
    c_m: list[Vector] | None = Field(default=None, description="centres of mass of the links, link frames")
    I_kg_m2: list[Matrix] | None = Field(
        default=None,
        description="inertia tensors about the centres of mass, link frames",
        json_schema_extra={"unit": "kg.m2"},
    )
    viscous: list[float] | None = Field(default=None, description="viscous friction, N.m.s/rad or kg/s")
    coulomb: list[float] | None = Field(default=None, description="Coulomb friction, N.m or N")
    rotor_inertia: list[float] | None = Field(
        default=None, description="inertias of the rotors times the gear ratio squared, kg.m2 or kg"
    )

    def modifiers(self) -> dict[str, Any]:
        """Return the arguments of `robots.serial_arm`. Raises InputError."""
        if wrong := implausible_arm(self.model_dump()):
            raise InputError(wrong[1], wrong[0])
        turning = self.joints if isinstance(self.joints, str) else "".join(k[:1] for k in self.joints)
        for key in ("limits", "start"):
            if getattr(self, f"{key}_deg") is not None and (getattr(self, key) is not None or "p" in turning):
                raise InputError(f"needs revolute joints only; give {key} instead, in rad and m", f"{key}_deg")
        arguments = {
            "a": self.a_m, "alpha": _radians(self.alpha_deg), "d": self.d_m, "theta": _radians(self.theta_deg),
            "beta": _radians(self.beta_deg), "convention": self.convention, "joints": self.joints, "names": self.names,
            "limits": self.limits or _radians(self.limits_deg), "start": self.start or _radians(self.start_deg),
            "base_xyz": self.base_m, "base_rpy": _radians(self.base_rpy_deg), "tool_xyz": self.tool_m,
            "tool_rpy": _radians(self.tool_rpy_deg), "m": self.m_kg, **self.moments(), "viscous": self.viscous,
            "coulomb": self.coulomb, "rotor_inertia": self.rotor_inertia, "title": self.title or "arm",
        }  # fmt: skip
        return {name: value for name, value in arguments.items() if value is not None}

    def moments(self) -> dict[str, Any]:
        """Return the model's parameters mc and J. Raises InputError."""
        if self.c_m is None and self.I_kg_m2 is None:
            return {}
        try:
            mc, J = moments(self.m_kg or np.zeros(len(self.a_m)), self.c_m, self.I_kg_m2)
        except ModelError as error:
            raise InputError(sentence_of(error), "c_m") from error
        return {"mc": mc, "J": J}


def _radians(degrees: Any) -> Any:
    return None if degrees is None else np.radians(degrees)


FAMILIES: dict[str, type[_Robot | SerialFile]] = {
    "three_link": RobotFile,
    "six_link": SixLinkFile,
    "f1": F1File,
    "serial": SerialFile,
}


def checked(data: Mapping[str, Any]) -> tuple[str, _Robot | SerialFile]:
    """Return the family of a robot file, three_link by default, and its checked keys. Raises InputError."""
    family = data.get("family", "three_link")
    if not isinstance(family, str) or family not in FAMILIES:
        hint = near(family, FAMILIES)
        raise InputError(f"expected one of {', '.join(FAMILIES)}; found {shown(family)}{hint}", "family")
    if "family" not in data:
        special = {k for k in ("B_m", "A0_mm", "B0_mm", "u1_2") if k in data}
        if special:
            meant = "six_link" if "B_m" in special else "f1"
            raise InputError(f'is missing; a file with {sorted(special)[0]} needs family = "{meant}"', "family")
    return family, cast(_Robot | SerialFile, validate(FAMILIES[family], data))


def is_robot_file(data: Mapping[str, Any]) -> bool:
    """Return True for data of a robot, not of a problem."""
    return "kind" not in data and (bool({"A_m", "A0_mm", "family"} & set(data)) or is_python_robot(data))


def is_python_robot(data: Mapping[str, Any]) -> bool:
    """Return True for another robot with parameters, in Python, URDF or TOML, as a calibration writes it."""
    name = str(data.get("robot", ""))
    another = is_reference(name) or is_arm_file(name) or name.endswith(".toml")
    return "kind" not in data and another and set(data) <= PYTHON_KEYS


def _refuse(misfit: float, key: str, more: str) -> None:
    if misfit > MISFIT:
        raise InputError(
            f"the links of a cluster deviate from parallel by {1e3 * misfit:.0f} mm at the best plate orientation, "
            f"expected at most {1e3 * MISFIT:.0f} mm; a sign or a row is probably wrong here{more}",
            key,
        )
