"""A robot in a TOML file: the keys of the printed tables in gtmodel/robots/data."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat

from .base import Section

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Positive = Annotated[list[PositiveFloat], Field(min_length=3, max_length=3)]
NotNegative = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=3, max_length=3)]


class RobotFile(Section):
    """A three-link Gantry-Tau; one entry or row per arm. Masses and friction left out come from `inertia`."""

    title: str = Field(default="", description="name of the robot")
    prototype: str = Field(default="", description="which machine it is")
    source: str = Field(default="", description="where the numbers come from")
    note: str = Field(default="", description="frame and remarks")
    A_m: Matrix = Field(description="cart joints at q = 0")
    v: Matrix = Field(description="guideway directions, not normalised: their length scales q")
    L_m: Positive = Field(description="link lengths")
    home_m: Vector | None = Field(default=None, description="a reachable position of the tool centre point")
    m_p_kg: PositiveFloat | None = Field(default=None, description="plate mass, joints and tool included")
    m_c_kg: Positive | None = Field(default=None, description="cart masses, joints included")
    m_a_kg: NotNegative | None = Field(default=None, description="masses of the link clusters")
    coulomb_N: NotNegative | None = Field(default=None, description="Coulomb friction of each cart")
    viscous_kg_s: NotNegative | None = Field(default=None, description="viscous friction of each cart")

    def modifiers(self, payload: float) -> dict[str, Any]:
        """Parameters of `robots.GantryTau`; payload [kg] is added to a plate mass given here."""
        A, v, L = np.array(self.A_m), np.array(self.v), np.array(self.L_m)
        home = A.mean(axis=0) + 0.7 * L.mean() * v.mean(axis=0) if self.home_m is None else self.home_m
        chosen = {
            "m_p": None if self.m_p_kg is None else self.m_p_kg + payload,
            "m_c": self.m_c_kg,
            "m_a": self.m_a_kg,
            "coulomb": self.coulomb_N,
            "viscous": self.viscous_kg_s,
        }
        given = {name: value for name, value in chosen.items() if value is not None}
        return {"A": A, "v": v, "L": L, "home": home, **given}
