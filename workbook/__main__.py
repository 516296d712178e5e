"""The workbook's command line."""

import sys

from workbook.main import main

if __name__ == "__main__":
    sys.exit(main())
