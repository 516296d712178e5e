"""The workbook's command line; the Makefile's targets call it.

What a command needs is imported when it runs: `check` needs no kernel, and `run` no report.
"""

import argparse
import io
import os
import sys
import threading
import time
from pathlib import Path

from replication.files import UserError, as_json, write_files


def main(arguments: list[str] | None = None) -> int:
    """Run one command; return the exit status: 0 done, 2 the input is not usable, 1 anything else."""
    parser = argparse.ArgumentParser(prog="python -m workbook", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (due, run, report, check, verify, lab, data):
        commands.add_parser(command.__name__, help=command.__doc__).set_defaults(command=command)
    commands.choices["run"].add_argument("notebook", type=Path, help="a notebook's .py source")
    commands.choices["verify"].add_argument(
        "--full", action="store_true", help="make a row of each kept table again, too"
    )
    options = vars(parser.parse_args(arguments))
    end_with_make()
    if sys.stdout is None:
        print("the standard output is closed; send it to a file or to /dev/null", file=sys.stderr)
        return 2
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # which may take ASCII only
            stream.reconfigure(errors="replace")
    try:
        find_folders()
        status = options.pop("command")(**options) or 0
        print(end="", flush=True)
        return status
    except UserError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    except ModuleNotFoundError as error:
        print(f"{error}: remove .venv, and make installs it again", file=sys.stderr)
        return 2
    except OSError as error:
        print(error, file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # a closed pipe, a full disk
        return 1
    except KeyboardInterrupt:
        print("interrupted; what was finished is kept", file=sys.stderr)
        return 130


def end_with_make() -> None:
    """End this process when the make that MAKE_PID names is no more."""
    process = int(os.environ.get("MAKE_PID", 0))  # 0: this process's own group, which lives

    def watch() -> None:
        try:
            while True:
                os.kill(process, 0)
                time.sleep(0.5)
        except ProcessLookupError:
            os._exit(1)
        except PermissionError:  # another user's process has its number
            return

    threading.Thread(target=watch, daemon=True).start()


def find_folders() -> None:
    """Make the folders of data that the environment names absolute: a kernel starts in another one."""
    from workbook.project import SETTINGS

    for variable in SETTINGS.get("folders", ()):
        if value := os.environ.get(variable):
            folder = Path(value).expanduser().resolve()
            if not folder.is_dir():
                raise UserError(f"{variable}={value}: no such folder; correct or unset it")
            os.environ[variable] = str(folder)


def due() -> None:
    """Print the goal of each notebook that is due."""
    from workbook.project import ROOT
    from workbook.stamps import drop_stale_caches, find_due

    if not os.access(ROOT, os.W_OK):
        raise UserError("This folder is read-only: copy it to where you may write, then run make")
    drop_stale_caches()
    print(*(f"run/{source.relative_to(ROOT)}" for source in find_due()))


def run(notebook: Path) -> None:
    """Execute a notebook and put what it makes in place."""
    # Where JupyterLab is installed, jsonschema makes a grammar of web addresses of it, in 3 s of every start.
    sys.modules["rfc3987_syntax"] = None  # type: ignore[assignment]
    from workbook import execution

    print(execution.run(notebook))


def report() -> None:
    """Write the verdicts, report.md, the versions and README's status, all or none."""
    made = _make_report()
    write_files(made)
    print(next(iter(made)))


def check() -> int:
    """Print every number with its verdict; exit 1 if one differs unexpectedly."""
    from workbook import judging
    from workbook.report import find_surprises, list_verdicts, refuse_stale

    refuse_stale(_make_report())
    verdicts = judging.verdicts()
    surprises = find_surprises(verdicts)
    print(list_verdicts(verdicts, judging.claims()))
    for cell in surprises:
        print(f"{cell}: differs, which is not expected")
    return int(bool(surprises))


def _make_report() -> dict[Path, bytes]:
    from workbook.report import make_report
    from workbook.stamps import refuse_faults

    refuse_faults()
    return make_report()


def verify(full: bool) -> int:
    """Write to verification.json and .md what ran here and whether it made what is committed; exit 1 if not."""
    from workbook.certificate import certify, write_certificate
    from workbook.project import ROOT

    about = certify(full)
    page = write_certificate(about)
    written = {"verification.json": as_json(about), "verification.md": page.encode()}
    write_files({ROOT / name: content for name, content in written.items()})
    print(page)
    return int(bool(about["differences"]))


def lab() -> None:
    """Copy the notebooks to lab/ for changes, and start JupyterLab there."""
    from workbook.lab import copy_notebooks, start

    if kept := copy_notebooks():
        print(f"lab/: {len(kept)} copies stay as they are; delete one to get a new one")
    start()


def data() -> None:
    """Fetch and verify the public data."""
    from workbook.project import find_hook

    print(*map(find_hook("fetch"), find_hook("checksums", dict)()), sep="\n")


if __name__ == "__main__":
    sys.exit(main())
