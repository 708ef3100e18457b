"""Engines carry runs to processors: local processes, a Dask cluster, or one GPU."""
