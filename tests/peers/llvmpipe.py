"""Mesa's llvmpipe as a peer of the rasteriser: triangle ids and depth, drawn by OpenGL on the CPU."""

from __future__ import annotations

import ctypes
import os

import numpy as np

VERTEX = """
#version 330
uniform mat4 clip;
in vec3 position;
void main() { gl_Position = clip * vec4(position, 1.0); }
"""
FRAGMENT = """
#version 330
layout(location = 0) out int triangle;
void main() { triangle = gl_PrimitiveID; }
"""
GL_LOWER_LEFT, GL_ZERO_TO_ONE = 0x8CA1, 0x935F


class Llvmpipe:
    """Draws indexed triangles, back faces culled, with reversed depth in float32.

    Raises RuntimeError where Mesa, EGL or moderngl is missing.
    """

    def __init__(self, positions: np.ndarray, indices: np.ndarray, width: int, height: int) -> None:
        os.environ.update(LIBGL_ALWAYS_SOFTWARE="1", GALLIUM_DRIVER="llvmpipe")
        try:
            import moderngl

            self.context = moderngl.create_context(standalone=True, backend="egl", require=330)
            find = ctypes.CDLL("libEGL.so.1").eglGetProcAddress
        except Exception as error:
            raise RuntimeError(f"OpenGL through EGL is not usable here: {error}") from error
        self.name = self.context.info["GL_RENDERER"]
        if "llvmpipe" not in self.name:
            raise RuntimeError(f"OpenGL is drawn by {self.name}, not by llvmpipe.")
        find.restype, find.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
        ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.c_uint)(find(b"glClipControl"))(GL_LOWER_LEFT, GL_ZERO_TO_ONE)
        self.program = self.context.program(VERTEX, FRAGMENT)
        buffers = [self.context.buffer(np.ascontiguousarray(array)) for array in (positions, indices)]
        self.triangles = self.context.vertex_array(self.program, [(buffers[0], "3f", "position")], buffers[1])
        self.ids = self.context.texture((width, height), 1, dtype="i4")
        self.depth = self.context.depth_texture((width, height))
        self.frame = self.context.framebuffer([self.ids], self.depth)
        self.context.enable(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self.context.depth_func = ">"

    def draw(self, view: np.ndarray, projection: np.ndarray) -> None:
        """Draw and wait."""
        self.frame.use()
        self.frame.clear(-1, depth=0.0)
        self.program["clip"].write(np.ascontiguousarray((projection @ view).T, np.float32))
        self.triangles.render()
        self.context.finish()

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Ids int32 and depth float32 (height, width), row 0 on top."""
        width, height = self.frame.size
        ids = np.frombuffer(self.ids.read(), np.int32).reshape(height, width)
        depth = np.frombuffer(self.depth.read(), np.float32).reshape(height, width)
        return ids[::-1], depth[::-1]
