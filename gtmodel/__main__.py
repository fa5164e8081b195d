"""The command `gtmodel` as a process of its own, which is ``python -m gtmodel`` too."""

import atexit
import gc
import sys

SELDOM = 300_000  # new objects between two searches for garbage; imports and a compiled motion are 110,000


def run() -> int:
    """Run the command line and return its exit code.

    Garbage is searched for seldom, and not when the process ends, whose memory is given back as a whole: what a command
    imports and compiles stays until then.
    """
    gc.set_threshold(SELDOM)
    atexit.register(gc.freeze)
    from gtmodel.cli import main  # here: its imports are searched as well

    return main()


if __name__ == "__main__":
    sys.exit(run())
