"""A run: its plan, its loop over frames and methods, and what its results have to say of themselves."""
