"""Read, write, process and join videos; PyAV is used here only."""
