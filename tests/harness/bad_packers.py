"""Packers that go wrong, each in one way, for the tests of the run loop."""

import ctypes
import os
import sys
import time

from shading_atlas_bench.kernels.runtime.opencl import SPEAKING
from shading_atlas_bench.packers.interface import Packer, Paper
from shading_atlas_bench.packers.sas import ShadingAtlasStreaming

ENDLESS = "__kernel void endless(__global volatile int *stop) { while (!*stop) {} }"


class Failing(ShadingAtlasStreaming):
    """Raises in its second frame."""

    name = "failing"

    def pack(self, frame):
        if frame.index == 1:
            raise RuntimeError("the second frame is one too many")
        return super().pack(frame)


class Sleeping(ShadingAtlasStreaming):
    """Hangs in Python."""

    name = "sleeping"

    def pack(self, frame):
        while True:
            time.sleep(0.01)


class Spinning(ShadingAtlasStreaming):
    """Hangs in a kernel, where Python gets no control back."""

    name = "spinning"

    def pack(self, frame):
        import numpy as np
        import pyopencl as cl

        device = frame.scene.device
        kernel = cl.Kernel(cl.Program(device.context, ENDLESS).build(), "endless")
        device.launch("gather/endless", kernel, 1, device.zeros(1, np.int32), local=1)
        device.finish()


class Pointless(ShadingAtlasStreaming):
    """Has nothing to do in any scene."""

    name = "pointless"

    def skip(self, scene):
        return "no scene needs it"


class Unprepared(Packer):
    """Cannot even be prepared."""

    name = "unprepared"
    paper = Paper("none", 2026, "")

    def prepare(self, scene):
        raise ValueError("this packer wants another scene")

    def pack(self, frame):
        raise AssertionError("never reached")

    def client(self, scene):
        raise AssertionError("never reached")


class Aborting(ShadingAtlasStreaming):
    """Takes its process with it in its third frame."""

    name = "aborting"

    def pack(self, frame):
        if frame.index == 2:
            os.abort()
        return super().pack(frame)


class Holding(ShadingAtlasStreaming):
    """Hangs in native code that never lets another thread run."""

    name = "holding"

    def pack(self, frame):
        ctypes.PyDLL(None).sleep(10_000)


class Exiting(ShadingAtlasStreaming):
    """Ends the program as if all were well."""

    name = "exiting"

    def pack(self, frame):
        sys.exit(0)


class Leaving(ShadingAtlasStreaming):
    """Ends the process as if all were well, where Python cannot object."""

    name = "leaving"

    def pack(self, frame):
        os._exit(0)


class AbortingBeside(ShadingAtlasStreaming):
    """Takes its process with it where other methods work beside it."""

    name = "aborting-beside"

    @property
    def leaves_unwritten(self):
        os.abort()


class LeavingBeside(ShadingAtlasStreaming):
    """Ends the process as if all were well where other methods work beside it."""

    name = "leaving-beside"

    @property
    def leaves_unwritten(self):
        os._exit(0)


class AbortingLater(ShadingAtlasStreaming):
    """Takes its process with it while another method's kernels are compiled beside it."""

    name = "aborting-later"

    @property
    def leaves_unwritten(self):
        time.sleep(0.4)
        os.abort()


class HoldingTheDevice(ShadingAtlasStreaming):
    """Hangs where all others wait for the device, in native code."""

    name = "holding-the-device"

    @property
    def leaves_unwritten(self):
        with SPEAKING:
            ctypes.CDLL(None).sleep(10_000)


class AbortingAtOnce(ShadingAtlasStreaming):
    """Takes its process with it in every frame."""

    name = "aborting-at-once"

    def pack(self, frame):
        os.abort()
