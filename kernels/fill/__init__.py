"""Filling of the texels of an atlas that nothing owns."""
