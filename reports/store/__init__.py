"""The results store, its documented columns, and CSV."""
