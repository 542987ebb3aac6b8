"""Each design choice beside what it was chosen over: cost and error, in one table. Run as `-m benchmarks.choices`."""
