"""Modelica and Optimica text: a class of a `.mo` or `.mop` file becomes a gtmodel class. Knows no robot.

Reading needs the package lark: `pip install 'gtmodel[modelica]'`.

    load                 "vdp.mop:VDP_Opt" -> a gt.Optimization or gt.Model, whose errors name lines of the text
    python_of            the same as the text of a Python module
    flat_of_text         the same as flat Modelica text, which reads back as the same class
    listing              what can be solved or simulated in a file
    ModelicaError        a sentence with file, line and the line itself
    first_guess          a simulation to start a problem of free time from
    simulated_guess      the same for any problem
    plain, step, whole   an expression without its unit, and numbers of an instant, which printed classes use
"""

from typing import TYPE_CHECKING

from .._lazy import public

if TYPE_CHECKING:
    from .classes import plain as plain, step as step, whole as whole
    from .start import first_guess as first_guess, held_inputs as held_inputs, simulated_guess as simulated_guess
    from .syntax import ModelicaError as ModelicaError
    from .translate import flat_of_text as flat_of_text, listing as listing, load as load, python_of as python_of

public(__name__)
