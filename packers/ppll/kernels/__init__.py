"""Kernels of per-pixel linked lists: making, limiting, moving and sending them."""
