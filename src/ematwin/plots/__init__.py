"""Figures of results: plotly, one look for all."""
