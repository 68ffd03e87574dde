"""Values that nothing expects, and valid ones with some of their parts changed to such."""

from __future__ import annotations

import copy
from typing import Any

from hypothesis import strategies as st

# Text that steers terminals, is markup, is a formula, leaves a folder, is no UTF-8, or is nothing.
TEXTS = st.sampled_from(
    [
        "", " ", "a[/]x", "[red]", "\x1b[2J", "\u202egnp", "a\0b", "=1+1", "-2", "@x", "../../x", "/etc/passwd", "..",
        "/dev/zero", "\ud800", "caf\udce9", "nan", "1e999", "x" * 5000, "<script>alert(1)</script>", "{}", "%s", "\r\n",
    ]
) | st.text(max_size=8)  # fmt: skip
NUMBERS = st.one_of(
    st.sampled_from([0, -1, 2**31, 2**63, -(2**63) - 1, 10**400, 1e308, -1e308, 5e-324, 0.0, -0.0]),
    st.integers(),
    st.floats(),
)
PLAIN = st.none() | st.booleans() | NUMBERS | TEXTS
JUNK = st.recursive(PLAIN, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3))
DEEP = st.sampled_from([100, 2_000, 100_000])  # levels of lists in lists


@st.composite
def changed(draw: st.DrawFn, value: Any, junk: st.SearchStrategy[Any] = JUNK) -> Any:
    """The value with up to three of its parts put in another's place, taken out, doubled or renamed."""
    found = copy.deepcopy(value)
    for _ in range(draw(st.integers(1, 3))):
        place = found
        while isinstance(place, dict | list) and place:
            key = draw(st.sampled_from(list(place) if isinstance(place, dict) else list(range(len(place)))))
            if isinstance(place[key], dict | list) and place[key] and draw(st.integers(0, 3)):
                place = place[key]
                continue
            _change(draw, place, key, junk)
            break
        else:
            found = draw(junk)
    return found


def _change(draw: st.DrawFn, place: dict[Any, Any] | list[Any], key: Any, junk: st.SearchStrategy[Any]) -> None:
    how = draw(st.sampled_from(["replace", "replace", "remove", "double", "rename"]))
    if how == "remove":
        del place[key]
    elif how == "replace":
        place[key] = draw(junk)
    elif isinstance(place, list):
        place.append(place[key])
    elif how == "rename":
        place[draw(TEXTS)] = place.pop(key)
    else:
        place[f"{key}_"] = place[key]


@st.composite
def damaged(draw: st.DrawFn, text: bytes) -> bytes:
    """The text cut off, with some bytes in place of others, or nested deeply somewhere."""
    how = draw(st.sampled_from(["cut", "put", "nest"]))
    at = draw(st.integers(0, len(text)))
    if how == "cut":
        return text[:at]
    if how == "put":
        return text[:at] + draw(st.binary(max_size=4)) + text[at + draw(st.integers(0, 4)) :]
    return text[:at] + draw(st.sampled_from([b"[", b'{"a":'])) * draw(DEEP) + text[at:]
