"""Packers that do not return where nobody packs yet, each in one place, for the tests of the commands."""

import ctypes
import os
import time

from shading_atlas_bench.packers.sas import ShadingAtlasStreaming


def hang():
    while True:
        time.sleep(0.01)


class InInit(ShadingAtlasStreaming):
    """Hangs when it is made."""

    name = "in-init"

    def __init__(self, **values):
        hang()


class InSkip(ShadingAtlasStreaming):
    """Hangs when it is asked what it has to do."""

    name = "in-skip"

    def skip(self, scene):
        hang()


class InSkipHolding(ShadingAtlasStreaming):
    """The same, in native code that never lets another thread run."""

    name = "in-skip-holding"

    def skip(self, scene):
        ctypes.PyDLL(None).sleep(10_000)


class LeavingInSkip(ShadingAtlasStreaming):
    """Ends the process as if all were well."""

    name = "leaving-in-skip"

    def skip(self, scene):
        os._exit(0)


class InInitLater(ShadingAtlasStreaming):
    """Hangs when it is made a second time."""

    name = "in-init-later"
    made = 0

    def __init__(self, **values):
        super().__init__(**values)
        type(self).made += 1
        if self.made > 1:
            hang()


class Unable(ShadingAtlasStreaming):
    """Cannot say whether it has anything to do."""

    name = "unable"

    def skip(self, scene):
        raise RuntimeError("oops")
