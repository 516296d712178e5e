import pytest

from studies import __main__ as studies
from studies import kept


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["claim"], "hardware"),
        ([], "hardware"),
        (["identify-joint"], "BACKLASH_DATA"),
        (["claims"], "BACKLASH_DATA"),
    ],
)
def test_a_study_that_is_unknown_or_has_no_data_is_one_line_and_writes_nothing(
    arguments, says, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    for write in ("write_kept", "write_text"):
        monkeypatch.setattr(kept, write, lambda *_: pytest.fail("written"))
    assert studies.main(arguments) == 2
    assert says in capsys.readouterr().err.strip().splitlines()[-1]
