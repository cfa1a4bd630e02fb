"""Formulas of docstrings, which are typed as in a letter (`a^2 = 4 P R (1 - nu^2) / (pi E)`), as TeX.

Nothing is rearranged: a slash stays a slash, a line stays a line. Names become letters, `^` and `_` raise and lower
what follows, words stay words.
"""

from __future__ import annotations

import re
from textwrap import dedent

LETTERS_OF_GREEK = (
    "alpha beta gamma delta epsilon zeta eta theta kappa lambda mu nu xi pi rho sigma tau phi psi omega "
    "Gamma Delta Theta Lambda Xi Pi Sigma Phi Psi Omega"
)
GREEK = {word: rf"\{word}" for word in LETTERS_OF_GREEK.split()} | {"lam": r"\lambda", "eps": r"\varepsilon"}
OPERATORS = ("sin", "cos", "tan", "sinh", "cosh", "exp", "log", "min", "max")
NAMED = ("clip", "diag", "div", "grad", "Re", "conj", "play", "stop", "dev", "sign", "sqrt", "Laplace", "mean")
ENGLISH = ("as", "at", "by", "if", "in", "is", "it", "no", "of", "on", "or", "to", "up")
"""Words of two letters that are no products."""
TOKEN = re.compile(
    r"(?P<gap> {2,})|(?P<space> )|(?P<relation><=|>=|->|\+-|\.\.\.)"
    r"|(?P<word>[A-Za-z]+(?:-[a-z]{2,})*)(?P<number>\d*)(?P<dual>\*(?=[\s),^|]|$))?(?P<sign>[+-](?= =))?"
    r"|(?P<digits>\d+(?:\.\d+)?|\.\d+)|(?P<raise>[\^_])|(?P<mark>.)"
)
RELATIONS = {"<=": r"\le ", ">=": r"\ge ", "->": r"\to ", "+-": r"\pm ", "...": r"\dots "}
MARKS = {
    "*": r"\cdot ",
    "·": r"\cdot ",
    "%": r"\% ",
    "{": "{",
    "}": "}",
    "&": r"\& ",
    "#": r"\# ",
    "<": r"\lt ",
    ">": r"\gt ",
}
LETTERS = re.compile(r"[A-Z]{2,3}|[a-z][A-Z]|d[a-zA-Z]|[a-z]{2}")
"""Products of letters, and differentials: words of this shape that are no words of English."""


def tex(block: str) -> str | None:
    """Return the lines of an indented block as TeX for a display; None where they are words, a table or code."""
    if "`" in block or not re.search(r"[=^/<>]", block):
        return None
    lines = [_line(line) for line in dedent(block).split("\n") if line.strip()]
    return "\\begin{aligned}\n" + " \\\\\n".join(f"& {line}" for line in lines) + "\n\\end{aligned}"


def _line(line: str) -> str:
    made = "".join(_parts(line.rstrip().replace(" . ", " · ")))
    # Words that follow each other are one text.
    return re.sub(r"\\text\{([^{}]*)\}(?:\\ \\text\{[^{}]*\})+", lambda run: _joined(run.group()), made)


def _joined(run: str) -> str:
    return rf"\text{{{' '.join(re.findall(r'{([^{}]*)}', run))}}}"


def _parts(line: str) -> list[str]:
    """TeX of every token of a line; what is raised or lowered is in braces."""
    made, at = [], 0
    while at < len(line):
        token = TOKEN.match(line, at)
        at = token.end()
        if token["raise"]:
            inner, at = _raised(line, at)
            made.append(f"{token['raise']}{{{inner}}}")
        elif token["space"]:
            made.append(_space(line, token.start()))
        elif token["word"] == "sqrt":
            inner, at = _raised(line, at + (line[at : at + 1] == " "))
            made.append(rf"\sqrt{{{inner}}}")
        else:
            made.append(_one(token))
    return made


def _space(line: str, at: int) -> str:
    """A space between factors says what a slash does not take; beside a word it is one between words."""
    before, after = re.search(r"[A-Za-z]*$", line[:at]).group(), re.match(r"[A-Za-z]*", line[at + 1 :]).group()
    if any(word and _name(word).startswith(r"\text") for word in (before, after)):
        return r"\ "
    return "" if {line[at - 1], line[at + 1]} & set("=+-<>:·/,;±") else r"\,"


def _raised(line: str, at: int) -> tuple[str, int]:
    """What `^`, `_` or a root takes: a group, or a number or name, its sign included."""
    closing = {"{": "}", "(": ")"}.get(line[at : at + 1])
    if closing:
        depth, end = 1, at + 1
        while depth and end < len(line):
            depth += (line[end] == line[at]) - (line[end] == closing)
            end += 1
        return "".join(_parts(line[at + 1 : end - 1])), end
    taken = re.compile(r"-?(?:\d+(?:\.\d+)?|[A-Za-z]+\d*(?:,[a-z]+)?|\+)").match(line, at)
    if taken is None:
        return "", at
    word = taken.group()
    plain = len(word) > 2 and word.isalpha() and word not in GREEK
    return (rf"\mathrm{{{word}}}" if plain else "".join(_parts(word))), taken.end()


def _one(token: re.Match[str]) -> str:
    if token["gap"]:
        return r"\qquad " if token.start() else r"\qquad" * (len(token["gap"]) // 4) + " "
    if token["relation"]:
        return RELATIONS[token["relation"]]
    if token["word"]:
        lowered = f"_{{{token['number']}}}" if token["number"] else ""
        raised = f"^{{{token['dual'] or token['sign']}}}" if token["dual"] or token["sign"] else ""
        return f"{_name(token['word'])}{lowered}{raised}"
    return MARKS.get(token.group(), token.group())


def _name(word: str) -> str:
    if word in GREEK:
        return f"{GREEK[word]} "
    if word in ("int", "sum"):
        return f"\\{word} "
    if word in OPERATORS:
        return f"\\{word} "
    if word in NAMED:
        return rf"\operatorname{{{word}}}"
    differential = len(word) > 1 and word[0] == "d" and word[1:] in GREEK
    if differential:
        return f"d{GREEK[word[1:]]} "
    if word not in ENGLISH and (len(word) == 1 or LETTERS.fullmatch(word)):
        return word
    return rf"\text{{{word}}}"
