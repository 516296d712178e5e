"""The form of every notebook: its headings, parameters, equations and exercises, and no plumbing in sight."""

import ast
import re
from itertools import chain

import nbformat
import pandas as pd
import pytest

import workbook
from replication import published
from workbook import execution
from workbook.checkout import notebook_files

HEADINGS = ["Claim", "Method", "Parameters", "Result", "Verdict", "Try changing", "Exercises"]
SOURCES = notebook_files("py")
PLUMBING = re.compile(
    r"workbook\.(export|check_parameters)|to_csv|savefig|os\.environ|REPLICATION_|^\s*assert\b",
    re.MULTILINE,
)
CUT_SHORT = re.compile(r"<t[hd]>[^<]*(\.\.\.|…)</t[hd]>")
TIMES = workbook.ROOT / "results" / "notebook_times.csv"


def tags(cell):
    return set(cell.metadata.get("tags", []))


def cells(name, kind="code"):
    return [cell for cell in execution.read_notebook(SOURCES[name]).cells if cell.cell_type == kind]


def text(name):
    return "\n".join(cell.source for cell in cells(name, "markdown"))


def numbered(section):
    return [int(number) for number in re.findall(r"^(?:\*\*)?(\d)\. ?", section, re.MULTILINE)]


@pytest.mark.parametrize("name", SOURCES)
def test_a_notebook_has_its_headings_in_order(name):
    assert re.findall(r"^## (.+)$", text(name), re.MULTILINE) == HEADINGS


@pytest.mark.parametrize("name", SOURCES)
def test_a_notebook_has_one_parameters_cell_and_what_follows_checks_every_parameter(name):
    code = cells(name)
    (position,) = [k for k, cell in enumerate(code) if "parameters" in tags(cell)]
    assert "plumbing" in tags(code[position + 1])
    assigned = re.findall(r"^(\w+) = ", code[position].source, re.MULTILINE)
    checked = re.findall(r"\b(\w+)=\(", code[position + 1].source)
    assert set(assigned) <= set(checked), "not checked"


@pytest.mark.parametrize("name", SOURCES)
def test_a_notebook_proposes_three_changes(name):
    proposed = text(name).partition("## Try changing")[2].partition("## Exercises")[0]
    assert numbered(proposed) == [1, 2, 3]


@pytest.mark.parametrize("name", SOURCES)
def test_a_notebook_has_three_exercises_each_with_a_solution_that_tests_its_answer(name):
    assert numbered(text(name).partition("## Exercises")[2]) == [1, 2, 3]
    solutions = [cell.source for cell in cells(name) if "solution" in tags(cell)]
    assert len(solutions) == 3
    assert all(re.search(r"^\s*assert ", source, re.MULTILINE) for source in solutions)


@pytest.mark.parametrize("name", SOURCES)
def test_no_cell_in_sight_holds_plumbing_and_one_closing_cell_exports(name):
    code = cells(name)
    seen = [cell.source for cell in code if not tags(cell) & execution.FOLDED]
    assert [PLUMBING.findall(source) for source in seen if PLUMBING.search(source)] == []
    closing = [cell for cell in code if "workbook.export(" in cell.source]
    assert len(closing) <= 1
    assert all("plumbing" in tags(cell) for cell in closing)


@pytest.mark.parametrize("name", SOURCES)
def test_the_verdict_ends_in_a_printed_sentence(name):
    notebook = execution.read_notebook(SOURCES[name]).cells
    begin = next(k for k, cell in enumerate(notebook) if cell.source.startswith("## Verdict"))
    end = next(k for k, cell in enumerate(notebook) if cell.source.startswith("## Try changing"))
    seen = [
        cell
        for cell in notebook[begin:end]
        if cell.cell_type == "code" and "plumbing" not in tags(cell)
    ]
    assert seen[-1].source.splitlines()[-1] == ")" or "print(" in seen[-1].source.splitlines()[-1]
    assert "print(" in seen[-1].source


@pytest.mark.parametrize("name", SOURCES)
def test_a_cell_in_sight_has_at_most_fifteen_lines(name):
    seen = [cell for cell in cells(name) if not tags(cell) & (execution.FOLDED | {"parameters"})]
    assert [cell.source for cell in seen if cell.source.count("\n") >= 15] == []


@pytest.mark.parametrize("name", SOURCES)
def test_the_first_figure_is_among_the_first_four_cells_after_the_parameters(name):
    executed = nbformat.read(SOURCES[name].with_suffix(".ipynb"), as_version=4).cells
    begin = next(k for k, cell in enumerate(executed) if "parameters" in tags(cell))
    outputs = chain(*(cell.get("outputs", []) for cell in executed[begin + 2 : begin + 6]))
    assert any("image/" in str(output.get("data", "")) for output in outputs)


OWN_PACKAGES = re.compile(r"(replication|backlash|workbook|studies)\b")


@pytest.mark.parametrize("name", [name for name in SOURCES if name < "12"])
def test_a_notebook_of_the_paper_imports_at_most_five_names_of_our_packages(name):
    imports = [
        node
        for cell in cells(name)
        for node in ast.walk(ast.parse(cell.source))
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    names = [
        alias.name
        for node in imports
        for alias in node.names
        if OWN_PACKAGES.match(getattr(node, "module", alias.name))
    ]
    assert len(names) <= 5, names


def test_links_to_the_glossary_name_one_of_its_anchors_which_are_those_of_its_headings():
    glossary = (workbook.ROOT / "notebooks" / "glossary.md").read_text("utf-8")
    anchors = dict(re.findall(r'^## <a id="(.+?)"></a>(.+)$', glossary, re.MULTILINE))
    assert len(anchors) == glossary.count("\n## ")
    assert list(anchors) == [heading.lower().replace(" ", "-") for heading in anchors.values()]
    links = chain(*(re.findall(r"glossary\.md#([^)]+)", text(name)) for name in SOURCES))
    assert set(links) <= set(anchors)


EQUATIONS = published.paper_map().query("element.str.startswith('Equation')").to_dict("records")


@pytest.mark.parametrize("row", EQUATIONS, ids=lambda row: row["element"])
def test_a_notebook_displays_the_equations_that_the_map_says_it_uses(row):
    number = row["element"].split()[1]
    assert row["notebooks"]
    for name in row["notebooks"].split():
        displayed = re.findall(r"\$\$(.*?)\$\$", text(name), re.DOTALL)
        assert any(f"\\tag{{{number}}}" in formula for formula in displayed), name


@pytest.mark.parametrize("name", notebook_files("ipynb"))
def test_no_table_of_a_notebook_is_cut_short(name):
    executed = nbformat.read(notebook_files("ipynb")[name], as_version=4)
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    tables = [
        output.data["text/html"] for output in outputs if "text/html" in output.get("data", {})
    ]
    assert [CUT_SHORT.search(table)[0] for table in tables if CUT_SHORT.search(table)] == []


@pytest.mark.parametrize("name", SOURCES)
def test_the_executed_notebook_beside_a_source_has_its_cells_and_no_error(name):
    executed = nbformat.read(SOURCES[name].with_suffix(".ipynb"), as_version=4)
    assert [cell.source for cell in executed.cells] == [
        cell.source for cell in execution.read_notebook(SOURCES[name]).cells
    ]
    outputs = [out for cell in executed.cells for out in cell.get("outputs", [])]
    assert outputs
    assert all(out.output_type != "error" for out in outputs)


@pytest.mark.parametrize("name", SOURCES)
def test_a_notebook_states_the_run_time_that_was_measured(name):
    said, unit = re.search(r"Run time:\s(\d+) (s|min)\.", text(name)).groups()
    seconds = int(said) * (60 if unit == "min" else 1)
    measured = pd.read_csv(TIMES).set_index("notebook")["seconds"][name]
    assert 0.6 * measured - 3 <= seconds <= 1.6 * measured + 3


def test_the_students_first_notebooks_take_a_minute_together():
    measured = pd.read_csv(TIMES).set_index("notebook")["seconds"]
    first = [name for name in measured.index if name[:2] in ("00", "01", "02", "04", "05", "06")]
    assert len(first) == 6
    assert measured[first].sum() <= 60
    assert measured[first[0]] <= 10
