"""Many drives at the same time on Dask."""
