"""Fuzzing of what comes from strangers, one file for each door that it comes through: `python -m tests.fuzz`."""
