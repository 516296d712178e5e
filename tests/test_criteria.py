import pytest

from replication import published


def test_every_claim_has_a_criterion_a_reason_for_it_and_an_alternative_that_could_win():
    claims = published.claims()
    for column in ("check", "criterion", "reason", "alternative"):
        assert (claims[column].astype(str).str.len() > 0).all(), column
    assert all(isinstance(published.criterion(claim), float) for claim in claims.index)


def test_the_criterion_of_an_unknown_claim_is_refused():
    with pytest.raises(KeyError, match="no_such_claim"):
        published.criterion("no_such_claim")


@pytest.mark.parametrize("claim", ["error_rad_small", "error_rad_large"])
def test_a_limit_that_the_text_prints_is_the_criterion(claim):
    assert published.criterion(claim) == published.value(f"text.{claim}")


def test_the_limit_of_the_relative_error_is_the_printed_one():
    assert published.criterion("error_below_10") == published.value("text.error_limit_percent")


def test_the_encoders_step_is_judged_to_its_printed_digit():
    assert published.criterion("encoder_step") == published.tolerance("text.encoder_step")


def test_the_known_amplitudes_are_judged_to_half_of_their_last_digit():
    assert published.criterion("static_reference") == published.half_last_digit("0.6263")


def test_what_encoder_bits_may_do_to_the_amplitude_is_the_smallest_printed_sd():
    assert published.criterion("bits_suffice") == published.column("Table 2", "sd").min()
