"""Kernels of Shading Atlas Streaming: patches, their blocks in the atlas, and samples."""
