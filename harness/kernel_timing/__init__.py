"""The time of every kernel against its error."""
