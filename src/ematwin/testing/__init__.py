"""Contract suites for parts of others: messages name the missing part and the remedy.

`model_contract` for kinds of actuators and `reader_contract` for file formats are classes that
pytest runs; `optimizer_contract` is a list of functions that raise AssertionError, and needs no
pytest.
"""
