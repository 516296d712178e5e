"""The machine on another paper, with no line of ours: each command of the page that says how to begin one."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from workbook import ROOT

PAGE = (ROOT / "notebooks" / "next_paper.md").read_text("utf-8")
TOY = ROOT / "tests" / "toy_paper"


@pytest.fixture(scope="module")
def replicated(tmp_path_factory):
    """An empty folder in which each command of the page was run; and what they said."""
    folder = tmp_path_factory.mktemp("toy")
    commands = "".join(re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL))
    variables = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    variables |= {"MACHINE": str(ROOT), "JUPYTER_PREFER_ENV_PATH": "1"}
    variables["PATH"] = f"{Path(sys.executable).parent}:{variables['PATH']}"
    ended = subprocess.run(
        ["sh", "-e", "-c", commands], cwd=folder, env=variables, capture_output=True, text=True
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    return folder, ended.stdout


def test_the_toy_has_no_line_of_ours():
    for file in TOY.rglob("*.*"):
        assert not re.search("replication|backlash|studies", file.read_text("utf-8")), file


def test_its_numbers_are_judged_and_its_claim_decided(replicated):
    folder, _ = replicated
    verdicts = pd.read_csv(folder / "results" / "verdicts.csv", index_col="id")
    assert dict(verdicts["agreement"]) == {"text.period": "agrees", "text.slower": "differs"}
    assert [*pd.read_csv(folder / "results" / "claims.csv")["verdict"]] == ["holds"]


def test_its_report_is_written_and_its_first_words_stand_in_the_readme(replicated):
    folder, _ = replicated
    page = (folder / "results" / "report.md").read_text("utf-8")
    assert "| Text, slower | 5% | 7.32 | 6.82 to 7.82 | differs |" in page
    assert "“small swings all take the same time”" in page
    assert "Wide is 60°." in page
    status = "1 of 2 printed numbers agree by our computation."
    assert f"begin -->\n{status}\n<!-- status: end" in (folder / "README.md").read_text("utf-8")


def test_its_rerun_is_certified(replicated):
    folder, said = replicated
    about = json.loads((folder / "verification.json").read_text("utf-8"))
    assert [run["why"] for run in about["runs"].values()] == [""]
    assert "run/notebooks/01_pendulum.py" in said
    assert "| notebooks run here with this code | 1 of 1," in said
    assert "1 agrees, 0 agrees weakly, 0 consistent, 1 differs, 0 not tested" in said
    assert "- no difference\n" in said
