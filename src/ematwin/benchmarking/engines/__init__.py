"""Engines carry runs to processors: local processes or a Dask cluster."""
