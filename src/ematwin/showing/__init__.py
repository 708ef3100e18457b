"""How results show themselves: a table of pandas, HTML in a notebook, a figure, a progress bar."""
