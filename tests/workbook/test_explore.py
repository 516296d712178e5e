"""The page to play with, in a real browser: its joint, its fit, its words, and that anyone can use it."""

import numpy as np
import pytest

from replication.best_fit import best_fit
from replication.characteristic import equation_10
from replication.joint import GAINS, identified_joint, simulate
from replication.records import Recording
from workbook import ROOT

pytestmark = pytest.mark.slow
ADDRESS = (ROOT / "notebooks" / "explore.html").as_uri()
READY = "!waiting && (shown.done || !shown.run)"
# Gravity, friction and gain as shares, and the backlash [rad].
SETTINGS = [(1.0, 0.0, 1.0, 8e-4), (0.5, 0.0, 1.25, 15e-4), (1.0, 0.2, 0.8, 3e-4)]
SLIDERS = {"delta": "2.1", "friction": "1.5", "gravity": "2", "noise": "2", "gain": "1.6"}


@pytest.fixture
def page(tab):
    page = tab(ADDRESS)
    page.wait_for_function(READY)
    return page


@pytest.mark.parametrize(("gravity", "friction", "gain", "delta"), SETTINGS)
def test_the_pages_joint_is_the_workbooks(page, gravity, friction, gain, delta):
    shares = f"{{ gravity: {gravity}, friction: {friction}, gain: {gain} }}"
    r = page.evaluate(f"Array.from(makeLog(simulate(makeJoint({shares}), {delta}), 0, 1))")
    joint = identified_joint()
    gains = {name: gain * getattr(joint, name) for name in GAINS}
    joint = joint._replace(G=gravity * joint.G, load_coulomb=friction * joint.G, **gains)
    v = simulate(joint, delta).v
    assert np.sqrt(np.mean((np.array(r) - (v - 100)) ** 2)) < 1e-4 * v.std()  # the bar is 5e-3


@pytest.mark.parametrize(("delta", "noise"), [(3e-4, 0.0), (15e-4, 0.3)])
def test_the_pages_fit_is_the_best_fit(page, delta, noise):
    log = f"makeLog(simulate(makeJoint({{}}), {delta}), {noise}, 1)"
    r, A = page.evaluate(f"[Array.from({log}), fitSignature({log}).A]")
    record = Recording(2e-3 * np.arange(2401), 100 + np.array(r), 100.0, 0.4, "the page's log")
    assert np.isclose(A, best_fit(record).amplitude_rps, rtol=0.01)


def test_the_pages_noise_is_uniform_within_its_half_amplitude_and_another_for_each_seed(page):
    run = "{ r: new Float64Array(9601) }"
    noise = np.array([page.evaluate(f"Array.from(makeLog({run}, 0.5, {seed}))") for seed in (1, 2)])
    assert np.abs(noise).max() <= 0.5
    assert np.allclose(noise.std(axis=1), 0.5 / np.sqrt(3), rtol=0.05)
    assert abs(np.corrcoef(noise)[0, 1]) < 0.08


def test_the_pages_curve_is_equation_10(page):
    A = np.linspace(0, 1.5, 16)
    ours = 1e3 * equation_10(A)
    assert np.allclose(page.evaluate(f"{A.tolist()}.map(equation10)"), ours, rtol=1e-12)


@pytest.mark.parametrize(
    ("example", "judged", "words"),
    [
        ("The paper's joint", "good", "The sensor works."),
        ("No play", "good", "Healthy, and read as healthy."),
        ("Loud noise", "bad", "Noise drowns the ring."),
        ("Some friction", "bad", "the fit expects half a turn"),
        ("Friction above gravity", "bad", "Gravity cannot overcome friction"),
        ("Vertical axis", "bad", "Without gravity"),
        ("Another drive", "bad", "made for the paper's joint"),
    ],
)
def test_an_example_says_whether_the_sensor_works_and_why_not(page, example, judged, words):
    page.get_by_role("button", name=example, exact=True).click()
    page.wait_for_function(READY)
    assert page.locator("#verdict").get_attribute("class") == judged
    assert words in page.inner_text("#verdict")
    read, true = (float(page.inner_text(name).split()[0]) for name in ("#read", "#true"))
    off = abs(read / true - 1) if true else 0
    assert (off <= 0.1) == (judged == "good") or example == "Loud noise"


def test_a_joint_that_runs_away_has_no_reading(page):
    for name, value in {"gain": "1.6", "gravity": "2", "delta": "2.1"}.items():
        page.fill(f"#{name}", value)
    page.evaluate(
        "SLIDERS.gain[2] = 3; byId('gain').max = 3; byId('gain').value = 3; waiting = true"
    )
    page.wait_for_function(READY)
    assert "runs away" in page.inner_text("#verdict")
    assert page.inner_text("#error") == "–"
    assert page.complaints == []


@pytest.mark.parametrize("other", ["0", "most"])
@pytest.mark.parametrize("name", SLIDERS)
def test_each_end_of_each_slider_is_judged_without_a_complaint(page, name, other):
    page.fill(f"#{name}", page.get_attribute(f"#{name}", "min") if other == "0" else SLIDERS[name])
    page.wait_for_function(READY)
    assert page.inner_text("#verdict").endswith(".")
    assert "NaN" not in page.inner_text("main")
    assert "NaN" not in page.inner_html("#curve-plot") + page.inner_html("#speed-plot")
    assert page.complaints == []


def test_everything_works_by_keyboard(page):
    reached = []
    for _ in range(14):  # seven examples, play, the moment, five sliders
        page.keyboard.press("Tab")
        reached.append(
            page.evaluate("document.activeElement.id || document.activeElement.textContent")
        )
        if reached[-1] == "delta":
            page.keyboard.press("ArrowRight")
            page.wait_for_function("shown.state.delta === 0.85")
        if reached[-1] == "play":
            before = page.inner_text("#play")
            page.keyboard.press("Space")
            assert page.inner_text("#play") != before
        if reached[-1] == "moment":
            page.keyboard.press("End")
            assert page.get_attribute("#moment", "aria-valuetext").startswith("400 ms")
    assert {"play", "moment", *SLIDERS, "No play", "Another drive"} <= {*reached}
    page.get_by_role("button", name="Vertical axis").press("Enter")
    page.wait_for_function("!waiting && shown.state.gravity === 0")
    page.wait_for_function(READY)
    assert page.get_attribute("#gravity", "aria-valuetext") == "0.0 N m"


@pytest.mark.parametrize("width", [390, 1440])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_fits_its_screen_without_a_complaint_a_request_or_a_barrier(
    tab, barriers, width, scheme
):
    page = tab(ADDRESS, width, scheme)
    for example in ("The paper's joint", "Some friction"):  # of both verdicts
        page.get_by_role("button", name=example).click()
        page.wait_for_function(READY)
        assert barriers(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    outside = """[...document.querySelectorAll('.numbers dd, .slider output')].filter(each =>
        each.getBoundingClientRect().right > each.closest('section').getBoundingClientRect().right).length"""
    assert page.evaluate(outside) == 0
    assert page.complaints == []
    assert page.outside == [ADDRESS]


def test_who_asks_for_less_motion_gets_a_still_picture(browser):
    context = browser.new_context(reduced_motion="reduce")
    page = context.new_page()
    page.goto(ADDRESS)
    page.wait_for_function(READY)
    assert page.inner_text("#play") == "Play"
    assert page.evaluate("moment") == 0
    context.close()
