"""Mechanical parts written in the language: frames, guideway, rods, bodies, friction, motor."""

from .bodies import PointMass
from .frames import Flange, PointFrame, World
from .friction import Friction, Frictionless, PiecewiseLinearFriction, TanhFriction
from .guideway import Guideway
from .motor import ForceMotor
from .rod import MidpointRod, Rod, UniformRod

__all__ = [
    "Flange",
    "ForceMotor",
    "Friction",
    "Frictionless",
    "Guideway",
    "MidpointRod",
    "PiecewiseLinearFriction",
    "PointFrame",
    "PointMass",
    "Rod",
    "TanhFriction",
    "UniformRod",
    "World",
]
