"""``python -m gtmodel``: the command line."""

import sys

from gtmodel.cli import main

sys.exit(main())
