"""What a notebook shows of a result: verdict, a table and a picture, as one small piece of HTML."""

from __future__ import annotations

from html import escape

from dqreg.report.colours import LEVELS
from dqreg.report.facts import motions_of
from dqreg.report.figure import encode
from dqreg.report.html import data_uri
from dqreg.report.page_tables import ADVICE, SIGNS, tiles_of
from dqreg.report.pictures import Panel, draw
from dqreg.report.report_data import ReportData, collect, unit_of
from dqreg.report.result_protocol import RegistrationResult

# Pixels of the picture's one or two panels.
WIDTH, HEIGHT = 520, 380


def notebook_html(result: RegistrationResult) -> str:
    """Verdict, numbers and, with source and target, a picture."""
    story = None if result.inputs is None else collect(result, result.inputs)
    level, unit = result.verdict.level, unit_of(result)
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in result.verdict.reasons)
    rows = [(name, f"{value} ({more})") for name, value, more in tiles_of(result, story, unit)]
    rows += [("Weakest motion", motion["words"]) for motion in motions_of(result)[:1]]
    rows += [("Other poses as good", str(len(result.alternatives)))] if result.alternatives else []
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return (
        f'<div style="border-left:6px solid {LEVELS[level]};padding:.2em .8em;margin:.4em 0">'
        f"<b>{SIGNS[level]} {level.upper()}</b> {ADVICE[level]}<ul style='margin:.2em 0'>{reasons}</ul></div>"
        f"<table>{cells}</table>{'' if story is None else _picture(story)}"
    )


def _picture(story: ReportData) -> str:
    states = ("before", "deviation") if story.found and story.T_before is not None else ("deviation",)
    jpeg = encode(draw(story, [Panel(state, "best") for state in states], WIDTH, HEIGHT), "jpeg")
    return f'<img alt="part and scan" style="max-width:100%" src="{data_uri(jpeg, "jpeg")}">'
