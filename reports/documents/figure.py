"""Figures of the documents, as SVG drawn from kept rows."""

from __future__ import annotations

from collections.abc import Callable
from math import log10

from reports.charts import COLOURS
from reports.documents.kept import Row

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 760, 400, 60, 150, 20, 45


def draw_sweep(rows: list[Row]) -> str:
    """FLIP error without video coding over server time, a point per cell, with the time's interval where it has one."""
    shown = [row for row in rows if row["server_ms_median"] and row["flip_lossless"] is not None]
    ends = [row[name] for row in shown for name in ("server_ms_low", "server_ms_median", "server_ms_high") if row[name]]
    across = _scale(log10(min(ends) / 1.1), log10(max(ends) * 1.1), LEFT, WIDTH - RIGHT)
    top = 1.1 * max(row["flip_lossless"] for row in shown)
    up = _scale(0.0, top, HEIGHT - BOTTOM, TOP)
    colours = dict(zip(dict.fromkeys(row["method"] for row in shown), COLOURS, strict=False))
    parts = [_axes(across, up, min(ends), max(ends), top)]
    for row in shown:
        x, y, colour = across(log10(row["server_ms_median"])), up(row["flip_lossless"]), colours[row["method"]]
        if row["server_ms_low"] is not None:
            x1, x2 = (across(log10(row[f"server_ms_{end}"])) for end in ("low", "high"))
            parts.append(f'<path d="M{x1:.1f} {y:.1f}H{x2:.1f}" stroke="{colour}" stroke-opacity=".5"/>')
        what = f"{row['method']} {row['varied']}".strip()
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"><title>{what}</title></circle>')
    for place, (method, colour) in enumerate(colours.items()):
        y = TOP + 20 + 22 * place
        parts.append(f'<circle cx="{WIDTH - RIGHT + 24}" cy="{y - 4}" r="5" fill="{colour}"/>')
        parts.append(f'<text x="{WIDTH - RIGHT + 36}" y="{y}">{method}</text>')
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif"'
    return f'{head} font-size="13">\n<rect width="100%" height="100%" fill="#fff"/>\n' + "\n".join(parts) + "\n</svg>\n"


def _scale(low: float, high: float, start: float, end: float) -> Callable[[float], float]:
    return lambda value: start + (value - low) / (high - low) * (end - start)


def _axes(
    across: Callable[[float], float], up: Callable[[float], float], fastest: float, slowest: float, top: float
) -> str:
    """Grid lines at 1, 2 and 5 times powers of ten of milliseconds, and at multiples of 0.02 of the error."""
    ticks = [mantissa * 10**power for power in range(-1, 6) for mantissa in (1, 2, 5)]
    parts = []
    for tick in ticks:
        if fastest <= tick <= slowest:
            x = across(log10(tick))
            parts.append(f'<path d="M{x:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#ddd"/>')
            parts.append(f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 17}" text-anchor="middle">{tick:g}</text>')
    for step in range(int(top / 0.02) + 1):
        y = up(0.02 * step)
        parts.append(f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{0.02 * step:.2f}</text>')
    middle = (LEFT + WIDTH - RIGHT) / 2
    parts.append(f'<text x="{middle}" y="{HEIGHT - 8}" text-anchor="middle">server time (ms)</text>')
    parts.append(f'<text x="{LEFT}" y="14">FLIP error, without video coding</text>')
    return "\n".join(parts)
