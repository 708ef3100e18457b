"""The interactive twin: sliders for its unknowns, its answer beside a recording's.

`ematwin.explore` gives the widget of a notebook, ``ematwin explore`` the same as a local page.
"""
