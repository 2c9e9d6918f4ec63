#!/usr/bin/env python3
"""Checks the wording of the project's texts; prints file:line, the phrase and the better one for each fault.

    check_phrases.py [--strict] [PATH...]

Without PATH it reads every tracked text except the changelog and copies of others' files. It ends with 1 on a fault
only with --strict. A line that must quote a banned phrase ends with the comment "phrases: quoted".
"""

import io
import pathlib
import re
import sys
import tokenize

from project_files import ROOT, project_files

SUFFIXES = {
    "", ".action", ".cc", ".cmake", ".cpp", ".css", ".h", ".hpp", ".html", ".in", ".js", ".json", ".md", ".mjs", ".msg",
    ".py", ".sh", ".srv", ".toml", ".ts", ".txt", ".xacro", ".xml", ".yaml", ".yml",
}  # fmt: skip
SKIPPED = re.compile(
    r"^(CHANGELOG\.md|LICENSE|cockpit/page/package-lock\.json|tools/check_phrases\.py|ros/vendored_interfaces/.*|packaging/licenses/.*|requirements.*\.txt|.*/generated/.*)$"
)
QUOTED = "phrases: quoted"
GLOSSARY = re.compile(r"(?<=## Terms\n).*?(?=\n## )", re.S)  # CONVENTIONS.md names the phrases that it replaces

# The stems of words that British spelling writes with -ise and -isation.
ISE = (
    "author capital categor central character custom discret emphas equal final formal general harmon initial item "
    "linear local material maxim memor minim mobil modern modular neutral normal optim organ parametr penal priorit "
    "quant random real recogn regular serial special stabil standard summar symbol synchron token util vector visual"
).replace(" ", "|")
IN_COMMENT = r"(?:^\s*(?://+|#+|\*)\s+|\.\s+)"  # the begin of a comment, or of a sentence

# (pattern, better words). Patterns are matched against single lines, upper and lower case alike unless (?-i:...).
RULES = [
    (r"\bmakers?\b", "Franka, or: the manufacturer"),
    (r"\banew\b", "again"),
    (r"\b(?:would|could|will|may|can|might|should) else\b", "otherwise"),
    (r"\belse (?:would|could|it would)\b", "otherwise"),
    (r"\bone behind (?:the |an)other\b", "in order, or: in sequence"),
    (r"\bfor people\b", "human-readable"),
    (
        r"(?<!there )\b(?:is|are|was) no (?:valid )?(?:arm|array|boolean|character|color|command|controllet|duration|feature"
        r"|file|folder|frame|identifier|integer|joint|JSON|list|log|mapping|model|name|number|option|path|pose|quaternion"
        r"|rotation|scene|string|text|torque|unit|YAML)s?\b(?! (?:for|in|of|on|to|with|that|left|here|there|at|has|was|is)\b)",
        "is not a valid ...",
    ),
    (r"\"(?-i:Of) (?:the|a|an|all|each|every|both|several|exciting|one)\b", 'a noun phrase ("Number of ...")'),
    (IN_COMMENT + r"(?-i:Of) (?:the|a|an|all|each|every|both|several|these|those)\b", "a sentence with its subject first"),
    (IN_COMMENT + r"(?-i:Whoever|Who)\b(?![^.]*\?)", "a sentence with its subject first"),
    (r"(?:^|[.:;]\s+)(?-i:Whoever|Who) (?:has|is|wants|needs|asks|uses)\b(?!.*\?)", "If you ..."),
    (r"\bwish(?:es|ed|ing)?\b", "request, or: update"),
    (r"\bwanted\b", "requested, desired, expected or required"),
    (r"\b(?<!you )(?<!we )(?<!to )wants?\b(?!\()", "requests, expects or requires"),
    (r"\bcommand words?\b|\b(?:one )?words? too many\b|\bwrong words?\b|\bwords? of the (?:program|command line)\b", "command, argument"),
    (r"puppet", "fake arm"),
    (r"\bpurses?\b|\benergy (?:books?|accounts?)\b|\bsettles? accounts\b", "energy balance, energy budget"),
    (r"\b(?:a|the|torque) blows?\b|\bblows of torque\b", "torque spike"),
    (r"\bwith one voice\b|\bdeaf\b", "a technical term"),
    (r"\bmeddl(?:e[sd]?|ing)\b", "interfere, modify"),
    (r"\bovertones?\b", "harmonics"),
    (r"\bunheard\b", "ignored, unidentifiable"),
    (r"\bspoilt\b", "corrupted, invalid"),
    (r"\bmore than once is once\b", "idempotent"),
    (r"\bnone that is not\b", "a positive statement"),
    (r"\bstands? twice\b", "duplicate"),
    (r"\btook (?:its|the) controllet out\b|\btakes? (?:its|their|the) author out\b", "deactivated the controllet"),
    (r"\bleaves? (?:a|the) record\b|\bleave_record\b", "record a cycle"),
    (r"\bhung up on\b|\bhangs? up on\b", "close the connection"),
    (r"\bmend(?:s|ed|ing)?\b", "fix, repair"),
    (r"\bthe meddler\b|\bwitness(?:es)?\b", "a technical term"),
    # American spelling.
    (rf"\b\w*(?:{ISE})is(?:e[drs]?|ing|ation|ations|able)\b", "American spelling: -ize, -ization"),
    (r"\banaly(?:se[drs]?|sing)\b(?! of)", "American spelling: analyze"),
    (r"(?:behavi|col|fav|hon|lab|neighb|flav|harb|vap)our", "American spelling: -or"),
    (r"\b(?:centi|milli|kilo|micro)?(?:metres?|centres?|centred|fibres?|calibres?)\b", "American spelling: -er"),
    (r"\b(?:model|label|travel|level|cancel|signal|channel|tunnel|total|equal)l(?:ed|ing|er|ers)\b", "American spelling: one l"),
    (r"\b(?:catalogues?|programmes?|judgements?|licences?|defences?|artefacts?|whilst|learnt|burnt|ageing|fulfils?)\b", "American spelling"),
]  # fmt: skip
# The same, for comments and strings only: in code these are ordinary names.
TEXT_RULES = [
    (r"\brigs?\b", "fixture"),
    (r"\bgrey\b", "American spelling: gray"),
]
# (files, phrase): keys of scenes that keep their names, with their types and the texts that name them.
KEPT = [
    (
        re.compile(
            r"^(?:scene/|sysid/(?:excitation|refine)/|experiments/scenes/|config/schemas/scene\.json$"
            r"|docs/scene_reference\.md$)"
        ),
        re.compile(r"overtones?", re.IGNORECASE),
    ),
]
COMPILED = [(re.compile(pattern, re.IGNORECASE), better) for pattern, better in RULES]
COMPILED_TEXT = [(re.compile(pattern, re.IGNORECASE), better) for pattern, better in TEXT_RULES]

COMMENT = re.compile(r"^(\s*)(//|#)\s+(.*?)\s*$")
BANNER = re.compile(r"^\s*(?://|#)\s*-{3,}\s")
ORPHAN = re.compile(r"^[\w'()`\"-]{1,16}[.;:)-]$")


def faults_of_comments(lines):
    """(number, phrase, better) of broken banners and of paragraphs whose last line is a single word."""
    previous = None
    for number, line in enumerate(lines, 1):
        match = COMMENT.match(line)
        if BANNER.match(line) and not re.search(r"\w\s+-{3,}$", line):
            yield number, line.strip(), "a banner on one line: // --- Title ---"
        if match and previous and previous[0] == match.group(1) and previous[1] == match.group(2):
            following = COMMENT.match(lines[number]) if number < len(lines) else None
            ends = following is None or following.group(1) != match.group(1)
            if ends and ORPHAN.match(match.group(3)) and len(lines[number - 2]) > 90:
                yield number, match.group(3), "no last line of a single word: shorten the comment or break it earlier"
        previous = match.groups() if match else None


def prose_of(text, suffix):
    """The lines of a file with its comments and strings only; all of it where there is no code."""
    lines = text.splitlines()
    if suffix in {".cpp", ".hpp", ".ts"}:
        return [" ".join(re.findall(r'"(?:[^"\\]|\\.)*"|//.*', line)) for line in lines]
    if suffix != ".py":
        return lines
    prose = [""] * (len(lines) + 1)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            for number, line in enumerate(token.string.splitlines(), token.start[0]):
                prose[number - 1] += f" {line}"
    return prose


def faults_of_text(text, suffix):
    text = GLOSSARY.sub(lambda glossary: "\n" * glossary.group().count("\n"), text)
    lines = text.splitlines()
    faults = list(faults_of_comments(lines)) if suffix in {".cpp", ".hpp", ".py", ".ts"} else []
    for patterns, checked in ((COMPILED, lines), (COMPILED_TEXT, prose_of(text, suffix))):
        for number, line in enumerate(checked, 1):
            for pattern, better in patterns:
                match = pattern.search(line)
                if match and QUOTED not in line:
                    faults.append((number, match.group().strip(), better))
    return sorted(faults)


def check(root, paths=()):
    faults, files = [], 0
    for path in [p.resolve() for p in paths] or project_files(root):
        name = path.relative_to(root).as_posix()
        if SKIPPED.match(name) or path.suffix not in SUFFIXES or path.stat().st_size > 500_000:
            continue
        content = path.read_bytes()
        if b"\0" in content:
            continue
        files += 1
        kept = [phrase for where, phrase in KEPT if where.match(name)]
        found = [
            fault
            for fault in faults_of_text(content.decode("utf-8", errors="replace"), path.suffix)
            if not any(phrase.fullmatch(fault[1]) for phrase in kept)
        ]
        faults += [f"{name}:{number}: '{phrase}': better: {better}" for number, phrase, better in found]
    return faults if files else [f"{root}: no text found, nothing would be checked"]


def main():
    arguments = [a for a in sys.argv[1:] if a != "--strict"]
    files = []
    for path in map(pathlib.Path, arguments):
        files += project_files(path.resolve()) if path.is_dir() else [path]
    found = check(ROOT, files)
    print("\n".join(found) or "no banned phrase")
    if found:
        print(f"{len(found)} phrases to edit")
    return 1 if found and "--strict" in sys.argv else 0


if __name__ == "__main__":
    sys.exit(main())
