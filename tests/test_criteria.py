import numpy as np
import pytest

from replication import published
from workbook import ROOT, judging

RULES = dict.fromkeys(("below", "at most", "above", "at least", "rounds to"), "one")
RULES |= dict.fromkeys(("interval below", "interval above", "p below"), "two")


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


@pytest.mark.parametrize(
    ("name", "limit", "holds", "fails"),
    [
        ("below", 3.0, 2.9, 3.0),
        ("at most", 3.0, 3.0, 3.1),
        ("above", 3.0, 3.1, 3.0),
        ("at least", 3.0, 3.0, 2.9),
        ("rounds to", 4e-4, 4.49e-4, 4.51e-4),
        ("rounds to", 4e-4, 3.51e-4, 3.49e-4),
        ("interval below", 3.0, (1.0, 2.9), (3.1, 4.0)),
        ("interval above", 3.0, (3.1, 4.0), (1.0, 2.9)),
        ("p below", 0.05, (0.01, 0.99), (0.99, 0.01)),
    ],
)
def test_every_rule_tells_what_holds_from_what_does_not(rule, name, limit, holds, fails):
    rule(name, limit)
    assert published.decide("monotone", holds) is True
    assert published.decide("monotone", fails) is False


@pytest.mark.parametrize(
    ("name", "limit", "measured"),
    [
        ("interval below", 10.0, (7.5, 19.9)),
        ("interval above", 10.0, (7.5, 19.9)),
        ("p below", 0.05, (0.2, 0.8)),
    ],
)
def test_what_lies_on_both_sides_of_its_limit_is_undecided(rule, name, limit, measured):
    rule(name, limit)
    assert published.decide("monotone", measured) is None


@pytest.mark.parametrize("name", RULES)
def test_what_was_not_measured_is_undecided_and_the_wrong_number_of_numbers_is_refused(rule, name):
    rule(name, 1.0)
    one, two = np.nan, (np.nan, np.nan)
    right, wrong = (one, two) if RULES[name] == "one" else (two, one)
    assert published.decide("monotone", right) is None
    with pytest.raises(ValueError, match="monotone"):
        published.decide("monotone", wrong)


@pytest.mark.parametrize(
    ("name", "holds"), [("at most", True), ("at least", True), ("below", False), ("above", False)]
)
@pytest.mark.parametrize("last_bits", [-1e-12, 0.0, 1e-12])
def test_rounding_in_the_last_bits_does_not_decide(rule, name, holds, last_bits):
    rule(name, 5e-5)
    assert published.decide("monotone", 5e-5 * (1 + last_bits)) is holds


def test_a_difference_beyond_rounding_decides(rule):
    rule("at most", 5e-5)
    assert published.decide("monotone", 5.0001e-5) is False


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


@pytest.mark.parametrize(
    ("step", "holds"), [(1.49e-5, True), (1.51e-5, False), (0.51e-5, True), (0.49e-5, False)]
)
def test_the_encoders_step_is_judged_to_its_printed_digit(step, holds):
    assert published.decide("encoder_step", step) is holds
    assert (abs(step - 1e-5) <= published.tolerance("text.encoder_step")) is holds


def test_the_largest_error_is_judged_as_its_cell_is_as_an_upper_bound():
    assert published.cells().loc["text.error_rad_large", "kind"] == "bound"
    assert published.decide("error_rad_large", 0.00017) is True
    assert published.decide("error_rad_large", 0.00041) is False
