"""Modelica and Optimica text: a class of a `.mo` or `.mop` file becomes a gtmodel class. Independent of robots.

The parser needs the package lark: `pip install 'gtmodel[modelica]'`.

    load                 "vdp.mop:VDP_Opt" -> a gt.Optimization or gt.Model, whose errors name lines of the text
    python_of            the same class as the text of a Python module
    flat_of_text         the same class as flat Modelica text, from which `load` gives the same class again
    listing              classes of a file that can be solved or simulated
    ModelicaError        an error message with file, line number and the line itself
    first_guess          a simulation as the initial guess of a problem with free time
    simulated_guess      the same for any problem
    plain, step, whole   an expression without its unit; a step and a floor at an instant. Printed classes use them
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .classes import plain as plain, step as step, whole as whole
    from .start import first_guess as first_guess, held_inputs as held_inputs, simulated_guess as simulated_guess
    from .syntax import ModelicaError as ModelicaError
    from .translate import flat_of_text as flat_of_text, listing as listing, load as load, python_of as python_of

public(__name__)
