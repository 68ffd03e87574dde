"""The reports: HTML files that need nothing else."""
