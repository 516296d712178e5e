"""The virtual sensor's command line."""

import sys

from backlash.main import main

if __name__ == "__main__":
    sys.exit(main())
