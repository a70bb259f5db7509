"""The page of a report: one HTML file, nothing fetched, no script, light or dark as the reader's screen is."""

from collections.abc import Iterable
from html import escape
from typing import Final

from hapscene.capture.report_figure import COLOURS, Key, Plot
from hapscene.capture.report_word import Fact, Row
from hapscene.surface.swatch import Swatch

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Content security policy: even if a text slipped through unescaped, nothing could run or be fetched."""

_GROUND = {"page": ("#f6f7f9", "#101418"), "card": ("#ffffff", "#181d23"), "line": ("#dfe3e8", "#2b323a")}

_RULES = """
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 24px 20px 48px; max-width: 1320px; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { margin: 0; font-size: 30px; line-height: 1.2; overflow-wrap: anywhere; }
h2 { margin: 36px 0 12px; font-size: 19px; }
h3 { margin: 0 0 6px; font-size: 15px; }
p { margin: 0 0 8px; overflow-wrap: anywhere; }
.muted, figcaption, .detail { color: var(--muted); }
.lead { margin-top: 6px; max-width: 80ch; }
.facts { display: grid; grid-template-columns: repeat(auto-fit, minmax(180px, 1fr)); gap: 12px; margin: 20px 0 0; }
.fact, figure { background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: 12px 14px; }
.fact .label { font-size: 13px; color: var(--muted); }
.fact .value { font-size: 22px; font-weight: 600; line-height: 1.3; }
.fact .detail { font-size: 13px; line-height: 1.4; }
.plots { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 390px), 1fr)); gap: 14px; }
figure { margin: 0; display: flex; flex-direction: column; }
figure svg { display: block; width: 100%; height: auto; max-width: 640px; margin: 4px auto; }
figure svg text { font-family: "DejaVu Sans", Verdana, "Bitstream Vera Sans", sans-serif !important; }
figcaption { font-size: 13px; line-height: 1.45; margin-top: 6px; }
.keys { display: flex; flex-wrap: wrap; gap: 2px 14px; font-size: 12.5px; line-height: 1.5; }
.keys span { display: inline-flex; align-items: center; gap: 6px; }
.keys svg { width: 24px; height: 10px; margin: 0; flex: none; }
.missing { flex: 1; display: flex; align-items: center; justify-content: center; min-height: 150px; text-align: center;
  border: 1px dashed var(--muted); border-radius: 6px; padding: 16px; margin: 6px 0; color: var(--muted); }
.table { overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: 8px; }
table { border-collapse: collapse; width: 100%; }
th, td { padding: 8px 14px; text-align: left; vertical-align: top; border-top: 1px solid var(--line); }
thead th { border-top: 0; font-size: 13px; font-weight: 600; color: var(--muted); }
tbody th { font-weight: 400; }
td.value { white-space: nowrap; font-variant-numeric: tabular-nums; font-weight: 600; }
.good, .short { white-space: nowrap; font-weight: 600; }
.good { color: var(--green); } .short { color: var(--orange); }
dl { display: grid; grid-template-columns: minmax(90px, max-content) 1fr; gap: 6px 18px; margin: 0; }
dt { color: var(--muted); } dd { margin: 0; overflow-wrap: anywhere; white-space: pre-line; }
@media (max-width: 640px) {
  body { padding: 16px 12px 32px; }
  .facts { grid-template-columns: 1fr 1fr; gap: 8px; }
  .fact, figure { padding: 10px; }
  thead { display: none; }
  tbody tr { display: grid; grid-template-columns: 1fr auto; border-top: 1px solid var(--line); padding: 8px 12px; }
  tbody tr:first-child { border-top: 0; }
  tbody th, tbody td { border: 0; padding: 0 6px 0 0; }
  tbody td.to { grid-column: 1; font-size: 13px; color: var(--muted); }
  dl { grid-template-columns: 1fr; gap: 0 0; } dd { margin-bottom: 10px; }
}
@media print { body { max-width: none; } figure, .fact { break-inside: avoid; } }
"""


def page(
    swatch: Swatch,
    lead: str,
    facts: Iterable[Fact],
    rows: Iterable[Row],
    plots: Iterable[Plot],
    absences: Iterable[tuple[str, str]],
    about: Iterable[tuple[str, str]],
) -> str:
    """The HTML of a report. Every text is escaped here; only the drawings of `plots` are taken as they are."""
    name = escape(swatch.name)
    judged = "".join(map(_row, rows))
    body = [
        f'<header><h1>{name}</h1><p class="lead">{escape(lead)}</p></header>',
        f'<div class="facts">{"".join(map(_fact, facts))}</div>',
    ]
    if judged:
        head = "<thead><tr><th>measure</th><th>here</th><th>held to</th><th></th></tr></thead>"
        body.append(f'<h2>How good it is</h2><div class="table"><table>{head}<tbody>{judged}</tbody></table></div>')
    body.append(f'<h2>Plots</h2><main class="plots">{"".join(map(_figure, plots))}</main>')
    absent = "".join(f"<dt>{escape(what)}</dt><dd>{escape(why)}</dd>" for what, why in absences)
    if absent:
        body.append(f"<h2>What is absent, and why</h2><dl>{absent}</dl>")
    known = "".join(f"<dt>{escape(what)}</dt><dd>{escape(text)}</dd>" for what, text in about)
    body.append(f"<h2>Where it comes from</h2><dl>{known}</dl>")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta name="color-scheme" content="light dark">\n<title>{name}: swatch report</title>\n'
        f"<style>{_colours()}{_RULES}</style>\n</head>\n<body>\n" + "\n".join(body) + "\n</body>\n</html>\n"
    )


def _colours() -> str:
    both = COLOURS | _GROUND
    light = " ".join(f"--{name}: {pair[0]};" for name, pair in both.items())
    dark = " ".join(f"--{name}: {pair[1]};" for name, pair in both.items())
    return f":root {{ {light} }} @media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}"


def _fact(fact: Fact) -> str:
    return (
        f'<div class="fact"><div class="label">{escape(fact.label)}</div><div class="value">{escape(fact.value)}</div>'
        f'<div class="detail">{escape(fact.detail)}</div></div>'
    )


def _row(row: Row) -> str:
    mark = {"good": "✓ good", "short": "✗ short", "": ""}[row.verdict]
    return (
        f'<tr><th>{escape(row.measure)}</th><td class="value">{escape(row.value)}</td>'
        f'<td class="to">{escape(row.held_to)}</td><td class="{row.verdict}">{mark}</td></tr>'
    )


def _figure(plot: Plot) -> str:
    keys = "".join(f"<span>{_mark(key)}{escape(key.text)}</span>" for key in plot.legend)
    drawing = f'<div class="missing">{escape(plot.caption)}</div>'
    caption = ""
    if plot.svg:
        label = escape(plot.alternative)
        drawing = plot.svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
        caption = f"<figcaption>{escape(plot.caption)}</figcaption>"
    legend = f'<div class="keys">{keys}</div>' if keys else ""
    return f"<figure><h3>{escape(plot.title)}</h3>{legend}{drawing}{caption}</figure>\n"


def _mark(key: Key) -> str:
    """The look of a legend's entry."""
    colour = f"var(--{key.colour})"
    dash = {"dashed": ' stroke-dasharray="6 3"', "dotted": ' stroke-dasharray="2 2.5"'}.get(key.look, "")
    shape = f'<line x1="0" y1="5" x2="24" y2="5" stroke="{colour}" stroke-width="2.4"{dash}/>'
    if key.look == "dot":
        shape = f'<circle cx="12" cy="5" r="4" fill="{colour}"/>'
    elif key.look == "ring":
        shape = f'<circle cx="12" cy="5" r="4" fill="none" stroke="{colour}" stroke-width="1.4"/>'
    elif key.look == "area":
        shape = f'<rect width="24" height="10" fill="{colour}"/>'
    return f'<svg viewBox="0 0 24 10" aria-hidden="true">{shape}</svg>'
