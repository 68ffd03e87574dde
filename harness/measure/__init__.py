"""One method measured on one frame: codecs, metrics, validity, and what is checked from outside."""
