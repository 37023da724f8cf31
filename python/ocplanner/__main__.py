"""``python -m ocplanner`` runs the command ``ocplanner``."""

import sys

from ocplanner.cli import main

if __name__ == "__main__":
    sys.argv[0] = "ocplanner"  # results record this name
    sys.exit(main())
