"""A kernel for examining a device."""
