import pytest

from studies import __main__ as studies


def test_an_unknown_study_is_one_line_that_names_those_that_there_are(capsys):
    for arguments in (["claim"], []):
        assert studies.main(arguments) == 2
        said = capsys.readouterr().err
        assert all(name in said for name in studies.STUDIES)
        assert said.count("\n") == 1


@pytest.mark.parametrize("name", ["identify-joint", "claims"])
def test_a_study_without_its_data_says_so_in_one_line_and_writes_nothing(
    name, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv("BACKLASH_DATA", str(tmp_path))
    monkeypatch.setattr(studies, "write_csv", lambda *_: pytest.fail("written"))
    monkeypatch.setattr(studies, "write_text", lambda *_: pytest.fail("written"))
    assert studies.main([name]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "BACKLASH_DATA" in said
