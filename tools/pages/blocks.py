"""The blocks of a Markdown page that can be run, and the marks that stand before them.

A mark is a comment in the source, which no reader of the page sees:

    <!-- not run: it needs a board -->   the next block is not run, for the reason given
    <!-- exit 1 -->                      its last command ends with this status
    <!-- serves -->                      its only command goes on until it is interrupted
    <!-- file: loss.csv -->              the next block is the content of this file, and is written
    <!-- figure: charts/a.svg | Words --> the site shows this file here
    <!-- slow page: why -->              the page takes long: it is run by `make check-slow`
"""

import re
from dataclasses import dataclass

from markdown_it import MarkdownIt

RUN = ("sh", "console", "python")
_MARK = re.compile(r"<!--\s*(not run|exit|serves|file|figure|slow page)\b:?\s*(.*?)\s*-->", re.DOTALL)


@dataclass(frozen=True)
class Block:
    """One fenced block: its language, text, first line in the page, end, and the marks before it."""

    language: str
    text: str
    line: int
    end: int
    marks: dict

    @property
    def runs(self):
        """Return True for a block that is to be run."""
        return self.language in RUN and "not run" not in self.marks


@dataclass(frozen=True)
class Figure:
    """A file that the site shows at this line, with the words beneath it."""

    path: str
    caption: str
    line: int


def read_page(text):
    """Return the blocks and the figures of a page, and the reason why it is slow ("" where it is not)."""
    blocks, figures, marks, slow = [], [], {}, ""
    for token in MarkdownIt("commonmark").parse(text):
        if token.type == "html_block":
            for kind, words in _MARK.findall(token.content):
                if kind == "figure":
                    path, _, caption = (part.strip() for part in words.partition("|"))
                    figures.append(Figure(path, caption, token.map[1]))
                elif kind == "slow page":
                    slow = words
                else:
                    marks[kind] = words
        elif token.type == "fence":
            blocks.append(Block(token.info.strip(), token.content, token.map[0] + 1, token.map[1], marks))
            marks = {}
        elif token.type == "inline":
            marks = {}
    return blocks, figures, slow


def session(text):
    """Return the commands of a console block, each with the lines that the page shows of its output."""
    found = []
    for line in filter(str.strip, text.splitlines()):
        if line.startswith("$ "):
            found.append((line.removeprefix("$ "), []))
        else:
            found[-1][1].append(line.strip())
    return found


def commands(text):
    """Return the commands of a shell block, one a line; lines that end in a backslash go on."""
    lines = text.replace("\\\n", " ").splitlines()
    return [line.strip() for line in lines if line.strip() and not line.strip().startswith("#")]
