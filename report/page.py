"""The page: one HTML file that needs nothing else, neither network nor scripts."""

import base64
import html
import pathlib

CSS = """
:root { color-scheme: light; }
body { margin: 0 auto; padding: 1.5rem 1.2rem 4rem; max-width: 62rem; background: #fff; color: #1f2933;
  font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", Arial, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .2rem; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .6rem; padding-bottom: .25rem; border-bottom: 2px solid #d5dbe3; }
h3 { font-size: 1.02rem; margin: 1.5rem 0 .4rem; }
p { margin: .5rem 0; max-width: 52rem; }
.lead { color: #4b5763; margin: 0 0 .8rem; }
nav { margin: .6rem 0 1rem; } nav a { margin-right: 1rem; }
a { color: #1d4f91; }
.tiles { display: grid; grid-template-columns: repeat(auto-fill, minmax(8.6rem, 1fr)); gap: .6rem; margin: 1rem 0; }
.tile { border: 1px solid #d5dbe3; border-radius: 6px; padding: .5rem .7rem; }
.tile b { display: block; font-size: 1.25rem; line-height: 1.25; } .tile span { color: #4b5763; font-size: .84rem; }
.tile.bad { border-color: #d9480f; background: #fff6f0; }
table { border-collapse: collapse; margin: .6rem 0 1rem; font-size: .9rem; width: 100%; }
th, td { text-align: left; vertical-align: top; padding: .28rem .6rem .28rem 0; border-bottom: 1px solid #e3e7ec; }
th { font-weight: 600; color: #4b5763; border-bottom: 1.5px solid #c3ccd6; }
th { vertical-align: bottom; line-height: 1.25; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; padding-left: .5rem; } td.n { white-space: nowrap; }
.one { white-space: nowrap; } td.none { color: #6b7785; } tr.bad td { background: #fff6f0; }
.facts th { width: 15rem; border-bottom: 1px solid #e3e7ec; }
.facts td { overflow-wrap: anywhere; }
.chip { display: inline-block; border-radius: 3px; padding: 0 .35rem; margin: 0 .2rem .1rem 0; }
.box { border-left: 4px solid #d9480f; background: #fff6f0; padding: .5rem .9rem; margin: 1rem 0; }
.box.fine { border-color: #2e8b57; background: #f2faf5; }
.box ul { margin: .2rem 0; padding-left: 1.2rem; }
figure { margin: .8rem 0 1.4rem; break-inside: avoid; } figure img { width: 100%; height: auto; display: block; }
figcaption { color: #4b5763; font-size: .86rem; margin-top: .2rem; }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(20rem, 1fr)); gap: .8rem; }
.pictures figure { margin: 0; } .pictures img { border: 1px solid #d5dbe3; border-radius: 4px; }
details { margin: .6rem 0; } summary { cursor: pointer; color: #1d4f91; }
pre { background: #f5f6f8; padding: .7rem; overflow-x: auto; font-size: .8rem; line-height: 1.4; }
.missing { color: #6b7785; font-style: italic; }
@media print { body { max-width: none; padding: 0; font-size: 10pt; } nav { display: none; } h2 { break-after: avoid; }
  table, .tile { break-inside: avoid; } pre { white-space: pre-wrap; } a { color: inherit; text-decoration: none; } }
"""


def escape(text):
    return html.escape(str(text), quote=True)


class Raw(str):
    """Text that is HTML already."""


def _inner(value):
    return value if isinstance(value, Raw) else escape(value)


def figures(value, digits=3):
    """A number with this many significant digits, without an exponent unless it is very large or small."""
    if value is None:
        return "not available"
    if value == 0:
        return "0"
    if abs(value) >= 1e5 or abs(value) < 1e-4:
        return f"{value:.{digits - 1}e}"
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e" in text else text


def table(head, rows, numeric=(), bad=()):
    """head: texts; rows: texts or Raw, None: not available; numeric: right-aligned columns; bad: rows to mark."""
    right = ["n" if i in numeric else "" for i in range(len(head))]
    cells = "".join(f'<th class="{right[i]}">{_inner(name)}</th>' for i, name in enumerate(head))
    body = []
    for number, row in enumerate(rows):
        columns = []
        for i, value in enumerate(row):
            if value is None:
                columns.append(f'<td class="{right[i]} none" title="not available">n/a</td>')
            else:
                columns.append(f'<td class="{right[i]}">{_inner(value)}</td>')
        body.append(f"<tr{' class=bad' if number in bad else ''}>{''.join(columns)}</tr>")
    return Raw(f"<table><thead><tr>{cells}</tr></thead><tbody>{''.join(body)}</tbody></table>")


def facts(pairs):
    """Two columns: what, and its value."""
    rows = "".join(f"<tr><th>{_inner(key)}</th><td>{_inner(value)}</td></tr>" for key, value in pairs)
    return Raw(f'<table class="facts"><tbody>{rows}</tbody></table>')


def tiles(entries):
    """(value, what, is it bad)"""
    return Raw(
        '<div class="tiles">'
        + "".join(
            f'<div class="tile{" bad" if bad else ""}"><b>{_inner(value)}</b><span>{_inner(what)}</span></div>'
            for value, what, bad in entries
        )
        + "</div>"
    )


def chips(names, colors):
    """Names of controllets on their colors."""
    return Raw(
        "".join(
            f'<span class="chip" style="background:{colors.get(name, "#eee")}">{escape(name)}</span>' for name in names
        )
        or "–"
    )


def box(sentences, fine=False):
    return Raw(
        f'<div class="box{" fine" if fine else ""}"><ul>'
        + "".join(f"<li>{_inner(s)}</li>" for s in sentences)
        + "</ul></div>"
    )


def image(path, caption, alt=None):
    kind = {".png": "image/png", ".svg": "image/svg+xml"}[pathlib.Path(path).suffix.lower()]
    data = base64.b64encode(pathlib.Path(path).read_bytes()).decode("ascii")
    return Raw(
        f'<figure><img src="data:{kind};base64,{data}" alt="{escape(alt or caption)}">'
        f"<figcaption>{_inner(caption)}</figcaption></figure>"
    )


def absent(sentence):
    return Raw(f'<p class="missing">{_inner(sentence)}</p>')


def paragraph(text):
    return Raw(f"<p>{_inner(text)}</p>")


def details(summary, content):
    return Raw(f"<details><summary>{_inner(summary)}</summary>{_inner(content)}</details>")


def preformatted(text):
    return Raw(f"<pre>{escape(text)}</pre>")


def page(title, lead, sections):
    """sections: (id, heading, [Raw, ...])"""
    links = "".join(f'<a href="#{escape(name)}">{escape(heading)}</a>' for name, heading, _ in sections)
    body = "".join(
        f'<section id="{escape(name)}"><h2>{escape(heading)}</h2>{"".join(parts)}</section>'
        for name, heading, parts in sections
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{CSS}</style></head>'
        f'<body><h1>{escape(title)}</h1><p class="lead">{_inner(lead)}</p><nav>{links}</nav>{body}</body></html>\n'
    )
