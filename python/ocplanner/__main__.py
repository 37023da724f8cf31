"""``python -m ocplanner`` is the command ``ocplanner``."""

import sys

from ocplanner.cli import main

if __name__ == "__main__":
    sys.exit(main())
