import subprocess
import sys

import pytest

from replication.workbook import ROOT


@pytest.mark.parametrize(
    ("code", "kept_out"),
    [
        ("from replication.commands import main", ("numpy", "replication.studies", "replication.report")),
        (
            "import replication.sensor.commands",
            ("cma", "matplotlib", "replication.studies", "replication.report", "replication.workbook"),
        ),
    ],
)
def test_a_command_imports_nothing_that_it_does_not_use(code, kept_out):
    code = f"import sys; {code}; print(*sys.modules, sep='\\n')"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert not set(loaded.splitlines()) & set(kept_out)
