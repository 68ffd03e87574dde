"""The rasteriser: visibility at each pixel, samples of it, and the triangles that it shows."""
