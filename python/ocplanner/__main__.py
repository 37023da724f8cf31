"""``python -m ocplanner`` is the command ``ocplanner``."""

import sys

from ocplanner.cli import main

if __name__ == "__main__":
    sys.argv[0] = "ocplanner"  # the name that results record
    sys.exit(main())
