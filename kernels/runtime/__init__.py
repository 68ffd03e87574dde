"""OpenCL runtimes: which of them the loader sees, which of their devices can be used, and their caches."""
