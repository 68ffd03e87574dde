"""Figures of the documents, as SVG drawn from kept rows."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby
from math import log2, log10

from shading_atlas_bench.reports.charts.figures import COLOURS
from shading_atlas_bench.reports.documents.kept import Row

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 760, 400, 60, 150, 20, 45
METHODS = ("sas", "snakebinning", "tss")  # of figures over samples
PANEL = 320  # width and height of one of their panels, two beside each other


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


def draw_samples(rows: list[Row]) -> str:
    """FLIP error over samples per pixel, a panel per scene and a line per method: whole without video coding, dashed
    with. Points that are not at the samples asked for are left out."""
    panels = [(scene, list(own)) for scene, own in groupby(rows, lambda row: row["scene"])]
    height = PANEL * -(-len(panels) // 2) + 30
    parts = [
        f'<g transform="translate({PANEL * 1.15 * (n % 2):.0f} {PANEL * (n // 2)})">\n{_panel(scene, own)}\n</g>'
        for n, (scene, own) in enumerate(panels)
    ]
    for place, (method, colour) in enumerate(zip(METHODS, COLOURS, strict=False)):
        x = LEFT + 120 * place
        parts.append(f'<circle cx="{x}" cy="{height - 14}" r="5" fill="{colour}"/>')
        parts.append(f'<text x="{x + 12}" y="{height - 10}">{method}</text>')
    parts.append(f'<text x="{LEFT + 370}" y="{height - 10}">dashed: at CRF 25</text>')
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" font-family="sans-serif"'
    return f'{head} font-size="13">\n<rect width="100%" height="100%" fill="#fff"/>\n' + "\n".join(parts) + "\n</svg>\n"


def _panel(scene: str, rows: list[Row]) -> str:
    """One scene's lines over its grid."""
    asked = [row["asked"] for row in rows]
    across = _scale(log2(min(asked)), log2(max(asked)), LEFT, PANEL)
    top = 1.1 * max(row[f"{kind}_{method}"] for row in rows for kind in ("flip", "coded") for method in METHODS)
    up = _scale(0.0, top, PANEL - BOTTOM, TOP + 10)
    parts = [f'<text x="{LEFT}" y="{TOP}" font-weight="bold">{scene}</text>']
    for value in asked:
        x = across(log2(value))
        parts.append(f'<path d="M{x:.1f} {TOP + 10}V{PANEL - BOTTOM}" stroke="#ddd"/>')
        parts.append(f'<text x="{x:.1f}" y="{PANEL - BOTTOM + 17}" text-anchor="middle">{value:g}</text>')
    step = 0.05 if top > 0.12 else 0.02
    for line in range(int(top / step) + 1):
        y = up(step * line)
        parts.append(f'<path d="M{LEFT} {y:.1f}H{PANEL}" stroke="#ddd"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{step * line:.2f}</text>')
    for kind, dash in (("flip", ""), ("coded", ' stroke-dasharray="5 4"')):
        for method, colour in zip(METHODS, COLOURS, strict=False):
            met = [row for row in rows if f"{method} " not in row["off"]]
            points = [f"{across(log2(row['asked'])):.1f} {up(row[f'{kind}_{method}']):.1f}" for row in met]
            if points:
                parts.append(f'<path d="M{"L".join(points)}" fill="none" stroke="{colour}" stroke-width="2"{dash}/>')
    parts.append(f'<text x="{(LEFT + PANEL) / 2}" y="{PANEL - 8}" text-anchor="middle">samples per pixel</text>')
    return "\n".join(parts)


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
