"""What a period costs, as docs/porting.md tells it.

`python -m tests.rig.cost_table` counts, and writes the table anew.
"""

from pathlib import Path

from tactuator.model.controller import Controller
from tactuator.rig.period_cost import count_instructions
from tests.rig.guard.guarded import adaptive, designed

BOARD = "mps2-an386"
FORMATS = {"float32": "float32", "Q31": "q31"}
DOCS = Path(__file__).resolve().parents[2] / "docs" / "porting.md"
BEGIN, END = "<!-- cost: begin -->\n", "<!-- cost: end -->\n"


def row(name: str, controller: Controller, number_format: str) -> str:
    """A line of the table."""
    return f"| {name} | " + " | ".join(map(str, counted(controller, number_format).values())) + " |\n"


def counted(controller: Controller, number_format: str) -> dict[str, int]:
    """Instructions of each case."""
    return count_instructions(BOARD, controller, number_format).cases


def table() -> str:
    """The table as it stands in the documentation."""
    cases = list(counted(designed(), "float32"))
    lines = ["| | " + " | ".join(cases) + " |\n", "|---|" + "---|" * len(cases) + "\n"]
    lines += [row(name, designed(), code) for name, code in FORMATS.items()]
    lines += [row(f"{name}, finger fed forward", adaptive(), code) for name, code in FORMATS.items()]
    return "".join(lines)


def documented() -> str:
    """The table that docs/porting.md has."""
    return DOCS.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0].strip() + "\n"


def main() -> None:
    """Count, and write the table into docs/porting.md."""
    before, rest = DOCS.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    DOCS.write_text(before + BEGIN + "\n" + table() + "\n" + END + after, encoding="utf-8")


if __name__ == "__main__":
    main()
