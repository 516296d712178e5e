"""The report: its content, and its behaviour in a real browser where one is installed."""

import importlib
import json
import re
import shutil
import subprocess
import time
import urllib.request
from collections import Counter

import pandas as pd
import pytest
import websocket

from replication import published, workbook
from replication.report import page as report
from replication.workbook import files, provenance

RESULTS = workbook.ROOT / "results"
NOTEBOOKS = workbook.ROOT / "notebooks"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@pytest.fixture(scope="module")
def page():
    return report.page(RESULTS, NOTEBOOKS)


def test_the_committed_page_is_what_the_results_give(page):
    committed = (RESULTS / "report.html").read_text(encoding="utf-8")
    assert committed == page, "run: make report"


def test_every_cell_claim_and_erratum_is_on_the_page(page):
    for name in [*published.cells().index, *published.claims().index]:
        assert f">{name}<" in page or f"({name})<" in page, name
    for name in published.errata().index:
        assert f'id="{name}"' in page


def test_every_reason_on_the_page_is_one_that_a_letter_points_to(page):
    pointed = set(re.findall(r'href="#([\w-]+-[a-z]{1,2})">\(', page))
    listed = set(re.findall(r'<li id="([\w-]+)">\(', page))
    assert pointed == listed
    assert len(listed) > 20


def test_every_exported_figure_is_on_the_page_with_its_notebook(page):
    drawn = {picture.name: picture for picture in report.pictures(workbook.ROOT / "figures", NOTEBOOKS)}
    assert set(drawn) == {path.stem for path in (workbook.ROOT / "figures").glob("*.svg")}
    for name, picture in drawn.items():
        assert f"<code>{name}</code>" in page
        assert f'save_figure(figure, "{name}")' in (NOTEBOOKS / f"{picture.notebook}.py").read_text(encoding="utf-8")


def test_ids_are_unique_and_every_reference_within_the_page_hits(page):
    ids = Counter(re.findall(r'\sid="([^"]+)"', page))
    assert max(ids.values()) == 1
    referred = re.findall(r'href="#([^"]+)"', page) + re.findall(r"url\(#([^)]+)\)", page)
    assert len(referred) > 100
    assert set(referred) <= set(ids)


def test_every_link_to_a_file_of_the_project_hits(page):
    links = set(re.findall(r'<a href="([^#"][^"]*)"', page))
    assert any(link.endswith(".ipynb") for link in links)
    assert all((RESULTS / link).exists() for link in links)


def test_the_page_is_self_contained_and_not_too_large(page):
    assert not re.search(r'(src|xlink:href|href)="(https?:)?//', page)
    assert "@import" not in page
    assert len(page.encode()) < 6_000_000


def test_the_sensitivity_matrix_has_the_order_of_the_paper_whatever_the_hash_seed(page):
    head = page[page.index('<table class="matrix">') :].partition("</thead>")[0]
    names = re.findall(r'<th scope="col">([^<]+)</th>', head)[3:-1]
    of_table_2 = ["Table 2, theoretical A", "Table 2, means and errors"]
    assert names == ["Table 1", *of_table_2, "Equation 10", "Text", "claims", "tests"]


def test_text_from_the_data_is_escaped(tmp_path):
    for name in ("outcomes", "figures"):
        (tmp_path / "results" / name).mkdir(parents=True)
    claims = published.claims().reset_index().assign(verdict="holds", measured="<b>1 & 2</b>", notebook="01_signature")
    claims.to_csv(tmp_path / "results" / "claims.csv", index=False)
    provenance.collect(tmp_path / "results")
    claims.to_csv(tmp_path / "results" / "claims.csv", index=False)
    assert "&lt;b&gt;1 &amp; 2&lt;/b&gt;" in report.page(tmp_path / "results", NOTEBOOKS)


def test_a_new_notebook_brings_its_figure_and_its_element(tmp_path):
    (tmp_path / "figures").mkdir()
    svg = '<?xml version="1.0"?><svg><defs><path id="m"/></defs><use xlink:href="#m"/></svg>'
    for name in ("figure10_new", "beyond_new"):
        (tmp_path / "figures" / f"{name}.svg").write_text(svg)
    source = '# %% [markdown]\n# ### A new result\n\n# %%\nworkbook.save_figure(figure, "figure10_new")\n'
    (tmp_path / "20_new.py").write_text(source + 'workbook.save_figure(figure, "beyond_new")\n')
    paper, beyond = report.pictures(tmp_path / "figures", tmp_path)
    assert (paper.element, paper.notebook, paper.caption) == ("Figure 10", "20_new", "A new result")
    assert 'id="figure10_new-m"' in paper.drawing
    assert 'xlink:href="#figure10_new-m"' in paper.drawing
    assert beyond.element == ""


def test_a_large_figure_goes_in_as_png(tmp_path):
    (tmp_path / "big.svg").write_text("<svg>" + " " * report.LARGEST_SVG + "</svg>")
    (tmp_path / "big.png").write_bytes(b"\x89PNG")
    (tmp_path / "20_new.py").write_text('workbook.save_figure(figure, "big")\n')
    (picture,) = report.pictures(tmp_path, tmp_path)
    assert str(picture.drawing).startswith('<img alt="" src="data:image/png;base64,')


def test_the_sources_are_named_by_the_same_commit_until_they_change(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    provenance.collect(first)
    sources = json.loads((first / "provenance.json").read_text(encoding="utf-8"))["sources"]
    assert re.fullmatch("[0-9a-f]{64}", sources["sha256"])
    noted = {"sources": sources | {"commit": "c" * 40}}
    files.write_json(first / "provenance.json", noted)
    provenance.collect(first)
    assert json.loads((first / "provenance.json").read_text(encoding="utf-8"))["sources"]["commit"] == "c" * 40
    files.write_json(second / "provenance.json", {"sources": noted["sources"] | {"sha256": "other"}})
    provenance.collect(second)
    assert json.loads((second / "provenance.json").read_text(encoding="utf-8"))["sources"] == sources


# ------------------------------------------------------------------------------------------------------ the README


def test_the_readmes_blocks_are_what_the_command_writes():
    text = (workbook.ROOT / "README.md").read_text(encoding="utf-8")
    assert report.block(text, "status").strip() == report.status(RESULTS).strip(), "run: python -m replication readme"
    assert report.block(text, "map").strip() == report.paper_map().strip(), "run: python -m replication readme"


def test_a_readme_without_the_marks_is_refused(tmp_path):
    (tmp_path / "README.md").write_text("no marks")
    with pytest.raises(ValueError, match="status: begin"):
        report.update_readme(tmp_path / "README.md", RESULTS)


def test_the_map_covers_every_figure_table_and_numbered_equation_of_the_paper():
    elements = published.paper_map()["element"].tolist()
    expected = [f"Figure {k}" for k in range(1, 14)] + [f"Table {k}" for k in range(1, 5)]
    assert elements == expected + [f"Equation {k}" for k in range(1, 20)]


@pytest.mark.parametrize("row", published.paper_map().to_dict("records"), ids=lambda row: row["element"])
def test_what_the_map_names_exists(row):
    for name in row["notebooks"].split():
        source = (NOTEBOOKS / f"{name}.py").read_text(encoding="utf-8")
        assert (NOTEBOOKS / f"{name}.ipynb").exists()
        number = re.search(r"\d+", row["element"])[0]
        if row["element"].startswith(("Figure", "Table")):
            kind = row["element"].split()[0].lower()
            assert re.search(rf"{kind}s?[^.]*\b{number}\b|{kind}0?{number}_", source, re.IGNORECASE)
    for name in row["functions"].split():
        module, _, function = name.rpartition(".")
        assert callable(getattr(importlib.import_module(f"replication.{module}"), function))
    if row["test"]:
        file, _, test = row["test"].partition("::")
        assert f"def {test}(" in (workbook.ROOT / file).read_text(encoding="utf-8")
    assert row["test"] or row["note"], "not reproduced, and no reason given"
    for erratum in re.findall(r"\bE\d+\b", row["note"]):
        assert erratum in published.errata().index


# ------------------------------------------------------------------------------------------------------- a browser


class Tab:
    """A tab of a browser, over the DevTools protocol; keeps every event."""

    def __init__(self, address):
        self.socket = websocket.create_connection(address, timeout=20, suppress_origin=True)
        self.sent, self.events = 0, []

    def call(self, method, **parameters):
        self.sent += 1
        self.socket.send(json.dumps({"id": self.sent, "method": method, "params": parameters}))
        while (message := json.loads(self.socket.recv())).get("id") != self.sent:
            self.events.append(message)
        assert "error" not in message, message
        return message["result"]

    def open(self, url):
        self.events.clear()
        self.call("Page.navigate", url=url)
        while not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self.events.append(json.loads(self.socket.recv()))

    def run(self, script):
        answer = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def press(self, key, code):
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed")
    profile = tmp_path_factory.mktemp("profile")
    flags = "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    flags += "--disable-component-update --disable-sync --remote-debugging-port=0"
    command = [program, *flags.split(), f"--user-data-dir={profile}", "about:blank"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(300):
            if (profile / "DevToolsActivePort").exists() or process.poll() is not None:
                break
            time.sleep(0.1)
        port = (profile / "DevToolsActivePort").read_text().split()[0]
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=20) as answer:
            target = next(tab for tab in json.load(answer) if tab["type"] == "page")
        tab = Tab(target["webSocketDebuggerUrl"])
        for domain in ("Page", "Network", "Runtime", "Log"):
            tab.call(f"{domain}.enable")
        yield tab
        tab.socket.close()
    finally:
        process.terminate()
        process.wait(timeout=20)


@pytest.fixture
def opened(browser, page, tmp_path):
    """The page, opened anew."""
    file = tmp_path / "report.html"
    file.write_text(page, encoding="utf-8")
    browser.open(file.as_uri())
    return browser


SHOWN = "[...document.querySelectorAll('tr.row')].filter(row => row.checkVisibility()).map(row => ({...row.dataset}))"
CHOOSE = (
    "(s => {{ s.value = {1!r}; s.dispatchEvent(new Event('change', {{bubbles: true}})); }})(filters.elements[{0!r}])"
)


def test_the_page_opens_without_an_error_and_without_a_request(opened):
    opened.run("new Promise(done => setTimeout(done, 300))")
    requested = [e["params"]["request"]["url"] for e in opened.events if e["method"] == "Network.requestWillBeSent"]
    assert [url.rpartition("/")[2] for url in requested if not url.startswith("data:")] == ["report.html"]
    bad = [
        event
        for event in opened.events
        if event["method"] == "Runtime.exceptionThrown"
        or (event["method"] == "Log.entryAdded" and event["params"]["entry"]["level"] == "error")
        or (event["method"] == "Runtime.consoleAPICalled" and event["params"]["type"] in ("error", "warning"))
    ]
    assert bad == []


def test_the_filters_show_the_rows_that_the_verdicts_have_and_reset_shows_all(opened):
    verdicts = pd.read_csv(RESULTS / "verdicts.csv")
    rows = len(verdicts) + len(published.claims())
    assert len(opened.run(SHOWN)) == rows
    opened.run(CHOOSE.format("verdict", "differs"))
    shown = opened.run(SHOWN)
    assert len(shown) == (verdicts["verdict"] == "differs").sum()
    assert {row["verdict"] for row in shown} == {"differs"}
    opened.run(CHOOSE.format("source", "simulated"))
    both = ((verdicts["verdict"] == "differs") & (verdicts["source"] == "simulated")).sum()
    assert len(opened.run(SHOWN)) == both
    assert opened.run("shown.textContent") == f"{both} of {rows} rows shown"
    opened.run(CHOOSE.format("element", "Table 1"))
    assert opened.run(SHOWN) == []
    opened.run("new Promise(done => { filters.reset(); setTimeout(done, 50); })")
    assert len(opened.run(SHOWN)) == rows


def test_a_filter_by_element_leaves_that_elements_section_only(opened):
    opened.run(CHOOSE.format("element", "Figure 9"))
    visible = "[...document.querySelectorAll('section[data-part]')].filter(s => !s.hidden).map(s => s.dataset.part)"
    assert opened.run(visible) == ["Figure 9"]
    opened.run(CHOOSE.format("element", "Claims"))
    assert opened.run(visible) == ["Claims"]


def test_the_filters_can_be_reached_and_set_by_keyboard(opened):
    for _ in range(100):
        opened.press("Tab", 9)
        if opened.run("document.activeElement.name") == "verdict":
            break
    opened.press("ArrowDown", 40)
    first = opened.run("document.activeElement.value")
    assert first == "reproduced"
    assert {row["verdict"] for row in opened.run(SHOWN)} == {first}


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_makes_the_page_wider_than_the_screen(opened, width):
    opened.call("Emulation.setDeviceMetricsOverride", width=width, height=844, deviceScaleFactor=1, mobile=width < 500)
    try:
        assert opened.run("document.documentElement.scrollWidth") <= width
    finally:
        opened.call("Emulation.clearDeviceMetricsOverride")


def test_every_verdict_says_in_words_what_its_colour_says(opened):
    words = set(opened.run("[...document.querySelectorAll('.verdict')].map(v => v.textContent.trim())"))
    assert words <= {f"{sign} {name}" for name, sign in report.SIGNS.items()}
    assert len(words) > 4
