"""Atlas packers: the interface, then one folder per method."""
