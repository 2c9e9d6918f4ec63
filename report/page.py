"""The frame of every page: one self-contained HTML file without scripts.

A page is a title, a lead and sections; a section is a heading and its parts. A part is HTML (Raw), a text (it becomes a
paragraph), a list of parts, or None (it is left out).
"""

import argparse
import base64
import html
import pathlib
import re

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
th { font-weight: 600; color: #4b5763; border-bottom: 1.5px solid #c3ccd6; vertical-align: bottom; line-height: 1.25; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; padding-left: .5rem; } td.n { white-space: nowrap; }
.one { white-space: nowrap; } td.none { color: #6b7785; } tr.bad td { background: #fff6f0; }
.facts th { width: 15rem; border-bottom: 1px solid #e3e7ec; vertical-align: top; }
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
NUMBER = re.compile(r"[-−+±≤≥×]?\s?\d")


class Raw(str):
    """Text that is HTML already."""


def escape(text):
    return html.escape(str(text), quote=True)


def _inner(value):
    return value if isinstance(value, Raw) else escape(value)


def _tag(name, content, classes=""):
    return f'<{name} class="{classes}">{content}</{name}>' if classes else f"<{name}>{content}</{name}>"


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


def known(value, scale=1.0, digits=3):
    """The scaled number as text; None, shown as "n/a", without a finite one."""
    return figures(scale * value, digits) if value is not None and abs(value) < float("inf") else None


# Tables --------------------------------------------------------------------------------------------------------------


def table(head, rows, bad=()):
    """head: texts, or one text with " | " between them; rows: numbers, texts, Raw, or None for "n/a".

    A column is aligned to the right if most of its cells are numbers; bad: numbers of the rows to mark.
    """
    head, rows = head.split(" | ") if isinstance(head, str) else head, [list(row) for row in rows]
    right = []
    for i in range(len(head)):
        cells = [str(row[i]) for row in rows if row[i] is not None and row[i] not in ("", "–")]
        right.append("n" if 2 * sum(bool(NUMBER.match(cell)) for cell in cells) > len(cells) else "")

    def cell(value, side):
        if value is None:
            return f'<td class="{side} none" title="not available">n/a</td>'
        return _tag("td", _inner(value), side)

    top = "".join(_tag("th", _inner(name), side) for name, side in zip(head, right))
    body = [
        _tag("tr", "".join(map(cell, row, right)), "bad" if number in bad else "") for number, row in enumerate(rows)
    ]
    return Raw(f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(body)}</tbody></table>")


def columns(entries, cells, bad=lambda entry: False):
    """A table with a row for each entry; cells: function of an entry by the head of its column; bad: marks an entry."""
    entries = list(entries)
    rows = [[cell(entry) for cell in cells.values()] for entry in entries]
    return table(list(cells), rows, [i for i, entry in enumerate(entries) if bad(entry)])


def facts(pairs):
    """Two columns: name and value."""
    rows = "".join(f"<tr><th>{_inner(key)}</th><td>{_inner(value)}</td></tr>" for key, value in pairs)
    return Raw(f'<table class="facts"><tbody>{rows}</tbody></table>')


# Other parts ---------------------------------------------------------------------------------------------------------


def tiles(*entries):
    """(value, what) or (value, what, whether it is bad)"""
    shown = [
        _tag("div", f"<b>{_inner(value)}</b><span>{_inner(what)}</span>", "tile bad" if any(bad) else "tile")
        for value, what, *bad in entries
    ]
    return Raw(_tag("div", "".join(shown), "tiles"))


def chips(names, colors):
    """Names of controllets in their colors."""
    chip = '<span class="chip" style="background:{}">{}</span>'
    return Raw("".join(chip.format(colors.get(name, "#eee"), escape(name)) for name in names) or "–")


def box(sentences, fine=False):
    """Empty without sentences."""
    if not sentences:
        return None
    return Raw(
        _tag("div", _tag("ul", "".join(_tag("li", _inner(s)) for s in sentences)), "box fine" if fine else "box")
    )


def image(path, caption, alt=None):
    kind = {".png": "image/png", ".svg": "image/svg+xml"}[pathlib.Path(path).suffix.lower()]
    data = base64.b64encode(pathlib.Path(path).read_bytes()).decode("ascii")
    return Raw(
        f'<figure><img src="data:{kind};base64,{data}" alt="{escape(alt or caption)}">'
        f"<figcaption>{_inner(caption)}</figcaption></figure>"
    )


def absent(sentence):
    return Raw(_tag("p", _inner(sentence), "missing"))


def heading(text):
    return Raw(_tag("h3", _inner(text)))


def details(summary, *parts):
    return Raw(f"<details><summary>{_inner(summary)}</summary>{body(parts)}</details>")


def preformatted(text):
    return Raw(_tag("pre", escape(text)))


# Page ----------------------------------------------------------------------------------------------------------------


def body(part):
    """HTML of a part."""
    if part is None or isinstance(part, Raw):
        return part or ""
    return _tag("p", escape(part)) if isinstance(part, str) else "".join(map(body, part))


def page(title, lead, sections):
    """sections: (heading, part, ...); one without any content is left out."""
    shown = [(heading, content) for heading, *parts in sections if (content := body(parts))]
    names = [re.sub(r"\W+", "-", heading.lower()).strip("-") or f"s{i}" for i, (heading, _) in enumerate(shown)]
    links = "".join(f'<a href="#{name}">{escape(heading)}</a>' for name, (heading, _) in zip(names, shown))
    parts = "".join(
        f'<section id="{name}"><h2>{escape(heading)}</h2>{content}</section>'
        for name, (heading, content) in zip(names, shown)
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><style>{CSS}</style></head>'
        f'<body><h1>{escape(title)}</h1><p class="lead">{_inner(lead)}</p><nav>{links}</nav>{parts}</body></html>\n'
    )


def write(file, text):
    """Writes a file atomically and returns its path."""
    part = file.with_name(file.name + ".part")
    part.write_text(text, encoding="utf-8")
    return part.replace(file)


def run(make, about):
    """Calls make(PATH) with the only argument of the command line; about: the docstring of the script."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("path", type=pathlib.Path)
    make(parser.parse_args().path)
