"""What the suite needs of a machine, and every kernel on each of its devices."""
