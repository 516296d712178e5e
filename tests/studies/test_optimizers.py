import numpy as np
import pandas as pd
import pytest

from replication.signature import rmse
from studies import claims, optimizers
from tests.made import TIME, TRUE, make_record
from workbook.judging import decide_all

RECORD = make_record(t=TIME[:801])


def result(method, kind, found, runs=30):
    rows = {"method": method, "kind": kind, "level": 2, "realisation": 1, "evaluations": 1000}
    return [rows | {"found": k < found} for k in range(runs)]


def test_the_cost_and_the_residuals_are_the_papers():
    cost = optimizers.Cost(RECORD, 0.0, 1000)
    unit = (TRUE - cost.box.lower) / (cost.box.upper - cost.box.lower)
    expected = rmse(RECORD.t, RECORD.v, TRUE)
    assert cost(unit) == pytest.approx(expected, rel=1e-9)
    assert np.linalg.norm(cost.residuals(unit)) == pytest.approx(expected, rel=1e-9)
    assert cost.of_members(np.array([TRUE]))[0] == pytest.approx(expected, rel=1e-9)
    assert cost.evaluations == 3


@pytest.mark.parametrize("method", optimizers.SEARCH_METHODS)
def test_a_method_spends_its_budget_and_a_seed_gives_the_same_run(method):
    _, run = optimizers.SEARCH_METHODS[method]
    best = []
    for _ in range(2):
        cost = optimizers.Cost(RECORD, 0.0, 400)
        with pytest.raises(optimizers.SearchEnded):
            run(cost, 5)
        assert 400 <= cost.evaluations < 400 + optimizers.POPULATION
        best.append(cost.best)
    assert best[0] == best[1]


@pytest.mark.parametrize(
    ("cma", "one", "others", "holds"),
    [(25, 2, 2, True), (25, 24, 2, None), (15, 14, 14, None), (2, 25, 2, False)],
)
def test_cma_es_beats_the_swarms_only_if_chance_is_ruled_out(cma, one, others, holds):
    rows = result("CMA-ES, population 300", "CMA-ES", cma)
    for name, found in zip(optimizers.SWARMS, [one, *[others] * 9], strict=False):
        rows += result(f"{name}, population 300", "swarm", found)
        rows += result(f"{name}, its own population", "swarm", 0)
    compared = optimizers.against_swarms(optimizers.success_table(pd.DataFrame(rows)))
    measured = {"cma_beats_swarms": claims.measure_swarms(compared)}
    assert decide_all(claims.write_all(measured))["cma_beats_swarms"][0] is holds
