"""The studies that take long: `python -m studies NAME` writes the tables of one."""

import argparse
import os
import sys
from collections.abc import Sequence

from replication.compilation import pinned_environment
from replication.files import UserError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one study and return the exit status: 0 done, 2 the name or the data are not there, 1 anything else."""
    os.environ |= pinned_environment()  # tests make rows again, and have to find the same digits
    from studies.kept import STUDIES, write_study

    parser = argparse.ArgumentParser(prog="python -m studies", description=__doc__)
    parser.add_argument("name", nargs="?", default="", help=", ".join(STUDIES))
    try:
        write_study(parser.parse_args(arguments).name)
    except UserError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main())
