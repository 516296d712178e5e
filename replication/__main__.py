"""The command line: the virtual sensor on logs, and what the Makefile does, where there is no make."""

import sys

from replication.commands.main import main

if __name__ == "__main__":
    sys.exit(main())
