"""Contract suites, for parts of others: they say what is missing, and what to do about it.

`model_contract` for kinds of actuators, `reader_contract` for file formats and `store_contract` for
stores of studies are classes that pytest runs; `optimizer_contract` is a list of functions that
raise AssertionError, and needs no pytest.
"""
