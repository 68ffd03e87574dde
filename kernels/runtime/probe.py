"""Asks the PoCL that comes with pyopencl which processor its compiler compiles for and which built-ins it links.

Run as a script, in a process of its own: a PoCL that does not suit the processor may abort. The first argument is the
folder to take as pyopencl's home; the others are macros. Prints as JSON the driver's version and the macros that the
compiler defines. With POCL_DEBUG=llvm the driver itself says on stderr which library of built-ins it takes.
"""

import json
import os
import sys


def ask(home: str, macros: list[str]) -> dict[str, str | list[str]]:
    """The version of home's PoCL, and those of `macros` (without their underscores) that its compiler defines."""
    os.environ["PYOPENCL_NO_CACHE"] = "1"  # of calls in Python; read at the import
    import numpy as np
    import pyopencl as cl

    os.environ["PYOPENCL_HOME"] = home
    (platform,) = (known for known in cl.get_platforms() if known.name == "Portable Computing Language")
    device = platform.get_devices()[0]
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    lines = [f"#ifdef __{macro}__\n    defined[{place}] = 1;\n#endif" for place, macro in enumerate(macros)]
    body = "\n".join(lines)
    source = f"kernel void ask(global int *defined) {{\n{body}\n}}"
    kernel = cl.Kernel(cl.Program(context, source).build(["-w"]), "ask")
    found = np.zeros(len(macros), np.int32)
    buffer = cl.Buffer(context, cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR, hostbuf=found)
    kernel(queue, (1,), (1,), buffer)
    cl.enqueue_copy(queue, found, buffer)
    return {"driver": device.driver_version, "macros": [m for m, value in zip(macros, found, strict=True) if value]}


if __name__ == "__main__":
    print(json.dumps(ask(sys.argv[1], sys.argv[2:])))
