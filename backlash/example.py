"""A log to begin with: a simulated joint with 0.8 mrad of backlash, twelve turns of its load."""

from importlib.resources import files
from pathlib import Path

from backlash.refusals import Refusal
from replication.files import read_committed

LOG = files("backlash") / "data" / "example.csv"
EXAMPLE_OPTIONS = "--torque torque --gear-ratio 100 --inertia-ratio 2 --gravity 30"


def write_example(path: Path = Path("example.csv")) -> str:
    """Write the log, which is no real joint's; return the command that estimates its backlash."""
    content = read_committed(LOG, str.encode)
    try:
        with path.open("xb") as file:
            file.write(content)
    except FileExistsError as error:
        raise Refusal(
            f"{path}: there is a file of this name; remove it, or go elsewhere"
        ) from error
    return f"backlash estimate {path} {EXAMPLE_OPTIONS}"
