"""Screens of the checks in harness/measure/validity.py: which samples and lookups they have to look at one by one."""
