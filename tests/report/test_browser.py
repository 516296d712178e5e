"""The report and a page in a real browser: widths, light and dark, keyboard, paper, no request."""

import pytest

from workbook import judging
from workbook.checkout import RESULTS
from workbook.report import cells as cells_of

VERDICTS = judging.verdicts(RESULTS)
WIDTHS = (390, 820, 1440)
PAGES = (
    "report.html",
    "pages/00_the_sensor.html",
    "pages/08_noise_table2.html",
    "pages/signature_explorer.html",
    "pages/replay_explorer.html",
)
OPENED = "document.querySelectorAll('details').forEach(each => each.open = true)"
SHOWN = "[...document.querySelectorAll('tr.row')].filter(row => !row.hidden).map(row => ({...row.dataset}))"


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_a_page_opens_without_a_word_on_the_console_and_without_a_request(tab, site, name):
    page = tab(site / name)
    page.wait_for_timeout(200)
    assert page.said == []
    assert [url for url in page.asked if not url.startswith("data:")] == [(site / name).as_uri()]


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (820, "light"), (1440, "dark")])
def test_axe_finds_no_serious_violation(tab, site, serious_violations, width, scheme):
    for name in PAGES:
        page = tab(site / name, width, scheme)
        page.evaluate(OPENED)
        page.evaluate("document.querySelector('.about')?.showPopover()")
        assert serious_violations(page) == [], name


@pytest.mark.slow
def test_nothing_makes_a_page_wider_than_the_screen(tab, site):
    for file in [site / "report.html", *sorted(site.glob("pages/*.html"))]:
        page = tab(file)
        page.evaluate(OPENED)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            assert page.evaluate("document.documentElement.scrollWidth") <= width, (
                file.name,
                width,
            )


def test_a_cell_is_opened_read_and_closed_by_keyboard_alone(tab, site):
    page = tab(site / "report.html")
    page.locator("[id='table2.row02.sd']").focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "table2.row03.theoretical"
    page.locator("[id='table2.row03.sd']").focus()
    page.keyboard.press("Enter")
    about = page.locator("[id='about-table2.row03.sd']")
    assert about.is_visible()
    assert "0.0138" in about.inner_text()
    assert "RERUN=1" in about.inner_text()
    page.keyboard.press("Escape")
    assert not about.is_visible()


def test_every_cell_says_in_words_what_its_colour_says(tab, site):
    page = tab(site / "report.html")
    texts = page.evaluate(
        "[...document.querySelectorAll('button.cell')].map(cell => [cell.className.split(' ')[1], cell.textContent])"
    )
    assert len(texts) == len(cells_of.judged_cells(VERDICTS))
    for verdict, text in texts:
        assert verdict in text


def test_the_filters_show_the_rows_that_the_verdicts_have_and_reset_shows_all(tab, site):
    page = tab(site / "report.html")
    page.evaluate(OPENED)
    assert len(page.evaluate(SHOWN)) == len(VERDICTS)
    page.locator("select[name=verdict]").select_option("differs")
    assert len(page.evaluate(SHOWN)) == (VERDICTS["verdict"] == "differs").sum()
    page.locator("select[name=source]").select_option("authors")
    both = ((VERDICTS["verdict"] == "differs") & (VERDICTS["source"] == "authors")).sum()
    assert {row["verdict"] for row in page.evaluate(SHOWN)} == {"differs"}
    assert page.locator("#shown").text_content() == f"{both} of {len(VERDICTS)} rows shown"
    page.locator("select[name=element]").select_option("Table 3")
    assert page.evaluate(SHOWN) == []
    page.get_by_role("button", name="show all").click()
    page.wait_for_function("document.getElementById('shown').textContent === 'all rows shown'")
    assert len(page.evaluate(SHOWN)) == len(VERDICTS)


def test_sorting_by_disagreement_keeps_every_row_and_show_all_restores_the_papers_order(tab, site):
    page = tab(site / "report.html")
    page.evaluate(OPENED)
    before = page.evaluate(SHOWN)
    page.locator("#order").select_option("disagreement")
    after = page.evaluate(SHOWN)
    assert len(after) == len(before) == len(VERDICTS)
    sizes = [float(row["disagreement"]) for row in after]
    assert sizes == sorted(sizes, reverse=True)
    assert not {row["verdict"] for row, size in zip(after, sizes, strict=True) if size >= 0} & {
        "stand-in",
        "undecided",
    }
    page.get_by_role("button", name="show all").click()
    page.wait_for_function("document.getElementById('order').value === ''")
    page.wait_for_timeout(100)
    assert page.evaluate(SHOWN) == before


def test_a_click_leads_from_a_cell_to_its_notebooks_verdict_and_back(tab, site):
    page = tab(site / "report.html")
    page.locator("[id='table2.row03.mean']").click()
    page.locator("[id='about-table2.row03.mean'] a[href^='pages/']").first.click()
    page.wait_for_url("**/pages/08_noise_table2.html#*")
    anchor = page.evaluate("decodeURIComponent(location.hash.slice(1))")
    assert page.locator(f"[id='{anchor}']").inner_text() == "Verdict"
    page.get_by_role("link", name="The report").click()
    page.wait_for_url("**/report.html")


def test_on_paper_every_cell_has_its_footnote_and_no_table_is_cut(tab, site):
    page = tab(site / "report.html", 718)  # as wide as A4 within its margins, at 96 dots per inch
    page.emulate_media(media="print")
    notes = page.evaluate(
        "[...document.querySelectorAll('.about')].filter(each => each.checkVisibility()).length"
    )
    assert notes == len(cells_of.judged_cells(VERDICTS))
    cut = page.evaluate(
        "[...document.querySelectorAll('table')].filter(t => t.checkVisibility())"
        ".filter(t => t.getBoundingClientRect().right > 720).map(t => t.caption?.textContent ?? t.className)"
    )
    assert cut == []


def test_on_paper_there_is_nothing_dark_and_nothing_to_click(tab, site):
    page = tab(site / "report.html", 718, "dark")
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    hidden = "nav, form, .close, .copy, .about .again, .about .strip, summary"
    shown = page.evaluate(
        f"[...document.querySelectorAll('{hidden}')].filter(each => each.checkVisibility()).length"
    )
    assert shown == 0
