"""The workbook's command line."""

import sys

from replication.commands.main import main

if __name__ == "__main__":
    sys.exit(main())
