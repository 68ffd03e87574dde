"""Lists of the fragments of each pixel: built, given an opacity, blended; what is seen through blended surfaces."""
