"""Results: the store, its documented columns, CSV and HTML."""
