"""No file of the tree contains a banned phrase: a vague or metaphorical word in place of a technical term.

Identifiers count as well. docs/reference/glossary.md lists the terms. Three uses are permitted: the stored names
"hapscene flight", flight.npz and flight.json of the session log; "round trip"; and the name PulseAudio.
"""

import re
import subprocess
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).resolve().parents[1]

SUFFIXES: Final = {
    ".py", ".pyi", ".js", ".html", ".css", ".md", ".golden", ".toml", ".jinja", ".yml", ".c", ".h", ".cpp", ".gd", ".cs"
}  # fmt: skip

BEGIN, END = r"(?<![A-Za-z])", r"(?![a-z])"

BANNED: Final = {
    rf"(?<![\"`]){BEGIN}[Tt]old{END}": "given, reported, printed",
    r"\b(?:is|are|be|as|was) none\b": "invalid, not found, absent; 0 disables",
    r"\bof (?:it|them)[.;:]": "name the object",
    r"\bin the place of\b": "instead of, at",
    r"\bsays? so\b": "reports, warns",
    rf"{BEGIN}[Hh]ears?{END}|{BEGIN}[Hh]eard{END}": "receives, listens, audible",
    rf"{BEGIN}shel(?:f|ves){END}": "swatch library panel",
    rf"{BEGIN}[Ss]ittings?{END}": "session",
    rf"(?<!hapscene ){BEGIN}[Ff]lights?{END}(?!\.npz|\.json)|{BEGIN}fly{END}": "session log, replay",
    rf"{BEGIN}[Ll]ateness{END}": "timing statistics, deadline misses",
    rf"{BEGIN}[Ss]oftness{END}": "falloff",
    r"\b(?:the house|ground floor|on the desk|own look)\b": "package, layer, connected devices, source material",
    rf"{BEGIN}squeals?{END}": "stick-slip",
    rf"{BEGIN}ear{END}": "audio monitor",
    rf"{BEGIN}[Ll]iving{END}|{BEGIN}lively{END}": "simulating; amplitude modulation",
    r"\b[Nn]obody\b|\b[Nn]o ?one\b": "name who",
    r"\bwhole numbers?\b": "integer",
    r"\balike\b": "similar, equal",
    r"\bever (?:less|more|nearer)\b": "decreases, increases, approaches",
    r"\bin words\b|\bgoes? by the name\b": "say it directly",
    r"\bgives? way\b|\blets? go\b": "releases",
    r"\bon its? own\b|\ba \w+ of (?:its|their) own\b": "separate, own",
    r"\bwho else\b|\bwhat else\b|\bwhoever\b": "say it directly",
    rf"{BEGIN}[Tt]hings?{END}": "name the object",
    rf"(?<![Rr]ound[ _-]){BEGIN}[Tt]rips?{END}|{BEGIN}tripped{END}": "safety stop",
    rf"(?<!type )(?<!pcm_){BEGIN}[Pp]ulses?{END}(?!Audio)": "heartbeat, impulse",
}
"""Pattern of each banned phrase, and what to write instead."""


def files() -> list[Path]:
    """Return the tracked text files, apart from this one."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a git checkout")
    paths = [ROOT / name for name in listed.stdout.splitlines()]
    return [file for file in paths if file.suffix in SUFFIXES and file.is_file() and file != Path(__file__)]


def test_banned_phrases() -> None:
    patterns = {re.compile(pattern): instead for pattern, instead in BANNED.items()}
    found = []
    for file in files():
        for number, line in enumerate(file.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
            for pattern, instead in patterns.items():
                if match := pattern.search(line):
                    found.append(f"{file.relative_to(ROOT)}:{number}: {match[0]!r}; use {instead}")
    assert found == []
