"""Results as a notebook shows them: a table of HTML under one line of words."""

from __future__ import annotations

from html import escape

import pandas as pd


def notebook_html(words: str, frame: pd.DataFrame) -> str:
    """``words`` above ``frame``, both escaped; four significant digits, an empty cell where there is no value."""
    table = frame.to_html(float_format=lambda value: f"{value:.4g}", na_rep="", border=0)
    return f"<p>{escape(words)}</p>{table}"
