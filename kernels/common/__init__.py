"""What the kernels of several stages share."""
