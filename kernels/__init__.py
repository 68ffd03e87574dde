"""OpenCL kernels, each beside its float64 NumPy twin, and the device they run on."""
