"""``gtmodel doctor``: what this machine has of what gtmodel uses, on one screen to paste into an issue.

report.py        the rows, whether gtmodel can do its main job, and what to do where it cannot
requirements.py  packages: what pyproject.toml asks for and what is installed
machine.py       Python, platform, C compiler, other programs, cache
trials.py        the solvers, tried in a process of their own: one that crashes takes nothing with it

Only the standard library is imported here, so that a missing package is a row and not a traceback.
"""
