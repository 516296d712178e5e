"""The virtual sensor's command line."""

import gc
import sys

from backlash.cli import main

if __name__ == "__main__":
    # Imports and compiled code leave objects that stay; looking through them again takes a twentieth of a run.
    gc.set_threshold(100_000)
    sys.exit(main())
