"""Entry point of the command `gtmodel` and of ``python -m gtmodel``."""

import atexit
import gc
import sys

SELDOM = 300_000  # new objects between two garbage collections; the imports and a compiled motion create 110,000


def run() -> int:
    """Run the command line and return its exit code.

    Garbage collection is rare, and off at exit: imported and compiled objects live until the process ends, and the
    operating system then frees all memory at once.
    """
    gc.set_threshold(SELDOM)
    atexit.register(gc.freeze)
    from gtmodel.cli import main  # here, so that the threshold applies to its imports as well

    return main()


if __name__ == "__main__":
    sys.exit(run())
