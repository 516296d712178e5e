import sys
from types import ModuleType

from workbook import sliders


def test_a_run_that_makes_the_results_draws_once_at_the_first_values(monkeypatch, tmp_path):
    monkeypatch.setenv("REPLICATION_OUT", str(tmp_path))
    drawn = []
    sliders(lambda **values: drawn.append(values), alpha=(4.0, 3.0, 6.0), delta=(1.5, 0.3, 2.1))
    assert drawn == [{"alpha": 4.0, "delta": 1.5}]


def test_by_hand_there_is_a_slider_for_each_number_with_its_first_value_and_its_ends(monkeypatch):
    monkeypatch.delenv("REPLICATION_OUT", raising=False)
    shown = {}
    widgets = ModuleType("ipywidgets")
    widgets.FloatSlider = lambda first, **options: (first, options["min"], options["max"])
    widgets.interact = lambda draw, **made: shown.update(made)
    monkeypatch.setitem(sys.modules, "ipywidgets", widgets)
    monkeypatch.setattr("workbook.outcomes.find_spec", lambda name: widgets)
    drawn = []
    sliders(lambda **values: drawn.append(values), alpha=(4.0, 3.0, 6.0))
    assert drawn == [{"alpha": 4.0}]  # stays in the saved notebook
    assert shown == {"alpha": (4.0, 3.0, 6.0)}
