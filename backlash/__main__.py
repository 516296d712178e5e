"""The virtual sensor's command line."""

import sys

from backlash.cli import main

if __name__ == "__main__":
    sys.exit(main())
