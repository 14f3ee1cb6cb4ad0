"""Read, write, process and join videos; only this package uses PyAV."""
