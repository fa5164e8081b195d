"""``gtmodel doctor``: programs and packages of this machine that gtmodel uses, on one screen to paste into an issue.

report.py        the rows, whether gtmodel can solve problems here, and advice if it cannot
requirements.py  packages: required by pyproject.toml, and installed
machine.py       Python, platform, C compiler, other programs, cache
trials.py        trials of the solvers in a separate process, which may crash

The package imports only the standard library, so that a missing package gives a row and not a traceback.
"""
