"""Checked, not believed: rules that hold whatever a method says of itself. One file for each kind of rule.

launches      Every launch inside `pack` is a stage "structs/..." or "gather/...", and a payload with samples has some
              of the latter. (payload.py)
plain         A payload is made of the interface's own classes and of arrays, bytes, numbers and text. (payload.py)
samples       The samples claimed are those listed, or the fragments that the client holds. (payload.py, lists.py)
raw bytes     The uncompressed size claimed is that of the lists, and no more than their fragments need. (lists.py)
colours       Texels, and the fragments of some pixels, have the colour and opacity that a float64 shading of their
              surface points gives. (payload.py, lists.py)
fragments     Lists hold the fragments that float64 rays meet, and their nearest ones are the rasteriser's. (lists.py)
pictures      What a client says that it shows in a pixel can be seen there. (pictures.py)
isolated      A client holds nothing of the server; it shows what it received, and nothing else. (isolation.py)

What is too much to check whole is chosen by a seed of the run, the frame and the method, so that no method can know it.
"""
