"""Charts of error against CPU time; `python -m benchmarks.chart --help`."""
