"""The harness: frames, reference, codecs, metrics, validity, run loop, command line."""
