"""The table of keys in docs/reference/studies.md is that of the code."""

from dataclasses import fields

from study_keys import BEGIN, END, PAGE, PARTS, attributes, table


def test_the_table_of_keys_is_that_of_the_code():
    told = PAGE.read_text().partition(BEGIN)[2].partition(END)[0].strip()
    assert told == table().strip(), "PYTHONPATH=python python tests/study_keys.py writes it"
    for _, kind in PARTS:
        assert [f.name for f in fields(kind)] == list(attributes(kind))
