"""What the replay explorer computes in the browser is what NumPy and the package compute."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from replication.bounds import into_box, margins_of
from replication.cmaes import random_normals
from replication.files import ROOT
from replication.signature import Box

PAGE = (ROOT / "studies" / "pages" / "replay_explorer.html.j2").read_text("utf-8")
BOX = Box(np.array([-2.0, 0.0]), np.array([3.0, 0.1]))


def run_script(names: list[str], before: str, printed: str):
    """What functions of the page, run by Node, give."""
    functions = [re.search(rf"^function {name}\(.*?^}}", PAGE, re.M | re.S)[0] for name in names]
    script = "\n".join([before, *functions, f"console.log(JSON.stringify({printed}))"])
    command = [shutil.which("node") or pytest.skip("no Node here"), "-e", script]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("seed", [1, 823840, 2**32 - 1])
def test_the_random_numbers_are_numpys(seed):
    found = run_script(["normals"], "", f"[...normals({seed}, 2101)]")
    assert found == pytest.approx(random_normals(seed)(1, 2101)[0], rel=1e-14)


def test_samples_are_bent_into_the_box_as_in_the_search():
    shares = np.linspace(-4, 5, 2000)
    width = BOX.upper - BOX.lower
    margin = (np.array(margins_of(BOX)) / width).T.tolist()
    expected = (into_box(BOX.lower + shares[:, None] * width, BOX) - BOX.lower) / width
    for i in range(2):
        printed = f"{shares.tolist()}.map(y => reflect(y, {i}))"
        found = run_script(["reflect", "bend"], f"const margin = {margin};", printed)
        assert found == pytest.approx(expected[:, i], abs=1e-12)
