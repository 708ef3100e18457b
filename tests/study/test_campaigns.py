"""A small size of benchmarks/fuzz.py."""

from benchmarks import fuzz


def test_damaged_files_are_read_or_refused():
    answers = fuzz.campaign(scale=0.03, only=[])
    assert len(answers) == 210
    assert [one for one in answers if "FAILED" in one["outcome"]] == []
    assert sum(one["outcome"] == "refused" for one in answers) > 50
