import numpy as np
import pytest

from replication import published
from workbook import ROOT, judging

LESS, MORE = 3 * (1 - 1e-12), 3 * (1 + 1e-12)
# Of each rule, its limit and what it tells of measured numbers; None is undecided.
TOLD = [
    ("below", 3.0, {2.9: True, LESS: False, MORE: False}),
    ("at most", 3.0, {LESS: True, MORE: True, 3.0001: False}),
    ("above", 3.0, {3.1: True, LESS: False, MORE: False}),
    ("at least", 3.0, {LESS: True, MORE: True, 2.9: False}),
    ("rounds to", 4e-4, {4.49e-4: True, 4.51e-4: False, 3.51e-4: True, 3.49e-4: False}),
    ("interval below", 3.0, {(1.0, 2.9): True, (3.1, 4.0): False, (2.0, 4.0): None}),
    ("interval above", 3.0, {(3.1, 4.0): True, (1.0, 2.9): False, (2.0, 4.0): None}),
    ("p below", 0.05, {(0.01, 0.99): True, (0.99, 0.01): False, (0.2, 0.8): None}),
]
# How many numbers each rule takes.
RULES = {name: np.size(next(iter(decided))) for name, _, decided in TOLD}


@pytest.fixture
def rule(replace_table):
    """Give the claim `monotone` another rule and limit."""

    def give(name, limit):
        table = published.table("claims")
        table.loc["monotone", ["rule", "criterion"]] = name, limit
        replace_table("claims", table)

    return give


def test_every_claim_has_a_criterion_a_reason_for_it_and_an_alternative_that_could_win():
    claims = published.table("claims")
    for column in ("check", "criterion", "reason", "alternative"):
        assert (claims[column].astype(str).str.len() > 0).all(), column
    assert all(isinstance(published.criterion(claim), float) for claim in claims.index)
    assert set(claims["rule"]) <= set(RULES)


@pytest.mark.parametrize(("name", "limit", "decided"), TOLD)
def test_every_rule_tells_what_holds_from_what_does_not_and_last_bits_decide_nothing(
    rule, name, limit, decided
):
    rule(name, limit)
    assert {measured: published.decide("monotone", measured) for measured in decided} == decided


@pytest.mark.parametrize("name", RULES)
def test_what_was_not_measured_is_undecided_and_the_wrong_number_of_numbers_is_refused(rule, name):
    rule(name, 1.0)
    one, two = np.nan, (np.nan, np.nan)
    right, wrong = (one, two) if RULES[name] == 1 else (two, one)
    assert published.decide("monotone", right) is None
    with pytest.raises(ValueError, match="monotone"):
        published.decide("monotone", wrong)


def test_another_limit_can_be_tried():
    assert published.decide("half_turn", 0.04) is True
    assert published.decide("half_turn", 0.04, {"half_turn": 0.03}) is False


def test_exactly_the_notebook_that_claims_csv_names_decides_a_claim():
    decided = judging.decided_claims(ROOT / "results")
    assert not decided["id"].duplicated().any()
    numbers = decided.set_index("id")["notebook"].str[:2].astype(int)
    assert numbers.to_dict() == published.table("claims")["decided_in"].to_dict()


def test_a_limit_that_the_text_prints_is_the_criterion():
    for claim in ("error_rad_small", "error_rad_large", "encoder_step"):
        assert published.criterion(claim) == published.value(f"text.{claim}")
    assert published.criterion("error_below_10") == published.value("text.error_limit_percent")
