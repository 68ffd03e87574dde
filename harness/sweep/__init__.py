"""`bench sweep`: run time against error, over a grid of parameters and settings."""
