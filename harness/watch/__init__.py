"""Processes: starting and ending them, telling how they ended, and the memory they may take."""
