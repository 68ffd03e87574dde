"""Ending what hangs, and telling how a process ended."""
