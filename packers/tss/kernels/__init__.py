"""Kernels of Tessellated Shading Streaming: primitives, their bins and places, and samples."""
